"""A tap on the loopback link of one simulated vehicle: it passes on what is said, until cut, and lets others speak."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from drivers.errors import SimulationError

HOST = "127.0.0.1"
Address = tuple[str, int]


class LinkTap(asyncio.DatagramProtocol):
    """Stands between a vehicle and the service at a port of its own. Made by `open_tap`."""

    def __init__(self, system_id: int, service: Address) -> None:
        self.system_id = system_id
        self.cut = False
        """Whether nothing gets through, either way."""
        self.port = 0
        self._service = service
        self._vehicle: Address | None = None
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        """Know where it stands."""
        self._transport = transport
        self.port = transport.get_extra_info("sockname")[1]

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Pass a datagram on to the other side."""
        if addr != self._service:
            self._vehicle = addr
        if not self.cut:
            self._send(data, self._vehicle if addr == self._service else self._service)

    def speak(self, frame: bytes) -> None:
        """Send a frame to the vehicle beside the service, cut or not, as another station would."""
        self._send(frame, self._vehicle)

    def error_received(self, exc: Exception) -> None:
        """One side is not there: what it does not hear is lost."""

    def _send(self, data: bytes, address: Address | None) -> None:
        if self._transport is not None and address is not None:
            self._transport.sendto(data, address)


@contextlib.asynccontextmanager
async def open_tap(system_id: int, service_port: int) -> AsyncIterator[LinkTap]:
    """Open a tap between a vehicle and the service's port on loopback. SimulationError when no port is free."""
    tap = LinkTap(system_id, (HOST, service_port))
    loop = asyncio.get_running_loop()
    try:
        transport, _ = await loop.create_datagram_endpoint(lambda: tap, local_addr=(HOST, 0))
    except OSError as error:
        raise SimulationError(f"no tap on the link at port {service_port} can be opened: {error}") from error
    try:
        yield tap
    finally:
        transport.close()
