"""The log of zenoh in this process, an event at a time: zenoh itself can only write it to the standard output."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Final

import zenoh

log = logging.getLogger(__name__)

_STDOUT: Final = 1
_LONGEST_EVENT_BYTES: Final = 2**18
_WAITING_BYTES: Final = 2**22


@contextlib.contextmanager
def zenoh_log(log_filter: str, take: Callable[[bytes], bool]) -> Iterator[None]:
    """Hand every event of zenoh's log to `take`, on a thread of its own, while the block lasts.

    Once in a process, and before zenoh is opened there. zenoh waits until there is room for what it logs, so `take` is
    quick. What it returns False for, which RUST_LOG asks for, and what Python prints still comes out.

    Each event is one packet, so that a line break in the name of a key makes no second event of it.
    """
    os.environ["RUST_LOG"] = ",".join(filter(None, (os.environ.get("RUST_LOG"), log_filter)))
    os.environ["NO_COLOR"] = "1"
    reading, writing = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    writing.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _WAITING_BYTES)
    sys.stdout.flush()
    before = os.dup(_STDOUT)
    printed, sys.stdout = sys.stdout, open(before, "w", closefd=False)  # noqa: SIM115 - closed below
    os.dup2(writing.fileno(), _STDOUT)
    writing.close()
    zenoh.init_log_from_env_or("off")

    def read() -> None:
        while event := reading.recv(_LONGEST_EVENT_BYTES):
            try:
                if not take(event):
                    os.write(before, event)
            except Exception as error:  # noqa: BLE001 - unread, the log would stop whatever zenoh does
                log.error("an event of zenoh's log could not be taken: %r", error)

    reader = threading.Thread(target=read, name="zenoh-log", daemon=True)
    reader.start()
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(before, _STDOUT)  # the last writer has gone: the reader ends
        sys.stdout = printed
        reader.join()
        reading.close()
        os.close(before)
