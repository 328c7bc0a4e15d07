"""Every transport by its scheme; a new one is a file here and a line in TRANSPORTS."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Final

from drivers.mavlink.transport import FrameHandler, LinkAddress, Scheme, Transport
from drivers.mavlink.transports.serial_line import open_serial_line
from drivers.mavlink.transports.tcp import open_tcp
from drivers.mavlink.transports.udp import open_udp

Opener = Callable[[LinkAddress, FrameHandler], AbstractAsyncContextManager[Transport]]

TRANSPORTS: Final[dict[Scheme, Opener]] = {
    "udpin": open_udp,
    "udpout": open_udp,
    "tcp": open_tcp,
    "serial": open_serial_line,
}


def open_transport(address: LinkAddress, on_frame: FrameHandler) -> AbstractAsyncContextManager[Transport]:
    """Return the transport of an address, open in an async `with` block; `on_frame` gets every frame received.

    LinkError when it cannot be opened and waiting would not help.
    """
    return TRANSPORTS[address.scheme](address, on_frame)
