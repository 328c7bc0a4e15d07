"""A tap on the loopback link of one simulated vehicle: it passes on what is said, well or badly; others may speak."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Coroutine
from typing import Any, Final

from drivers.clock import Clock, SystemClock
from drivers.errors import SimulationError
from drivers.simulation.impairment import UNIMPAIRED

HOST = "127.0.0.1"
Address = tuple[str, int]
AGAIN_S: Final = 0.2
"""How often a frame is said that is said again and again."""


class LinkTap(asyncio.DatagramProtocol):
    """Stands between a vehicle and the service at a port of its own. Made by `open_tap`."""

    def __init__(self, system_id: int, service: Address, clock: Clock, seed: str) -> None:
        self.system_id = system_id
        self.impairment = UNIMPAIRED
        """What befalls each datagram, either way."""
        self.cut = False
        """Whether nothing gets through, either way."""
        self.mute = False
        """Whether nothing of the vehicle gets through; it is still spoken to."""
        self.port = 0
        self._clock = clock
        self._draws = random.Random(seed)  # noqa: S311 - noise, not secrets
        self._under_way: set[asyncio.Task[None]] = set()
        self._saying: asyncio.Task[None] | None = None
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
        if self.cut or (self.mute and addr != self._service):
            return
        to = self._vehicle if addr == self._service else self._service
        for after_s in self.impairment.arrivals_s(self._draws):
            if after_s <= 0.0:
                self._send(data, to)
                continue
            self._begin(self._send_later(data, to, after_s))

    def speak(self, frame: bytes) -> None:
        """Send a frame to the vehicle beside the service, cut or not, as another station would."""
        self._send(frame, self._vehicle)

    def keep_saying(self, frame: bytes | None) -> None:
        """Speak a frame again and again from now on, as another station would; None: no more."""
        if self._saying is not None:
            self._saying.cancel()
        self._saying = None if frame is None else self._begin(self._say_on(frame))

    def error_received(self, exc: Exception) -> None:
        """One side is not there: what it does not hear is lost."""

    def lose_all(self) -> None:
        """Lose what is under way."""
        for task in self._under_way:
            task.cancel()

    def _begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.ensure_future(work)
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)
        return task

    async def _say_on(self, frame: bytes) -> None:
        while True:
            self.speak(frame)
            await self._clock.sleep(AGAIN_S)

    async def _send_later(self, data: bytes, address: Address | None, after_s: float) -> None:
        await self._clock.sleep(after_s)
        if not self.cut:
            self._send(data, address)

    def _send(self, data: bytes, address: Address | None) -> None:
        if self._transport is not None and address is not None:
            self._transport.sendto(data, address)


@contextlib.asynccontextmanager
async def open_tap(
    system_id: int, service_port: int, clock: Clock | None = None, seed: str = ""
) -> AsyncIterator[LinkTap]:
    """Open a tap between a vehicle and the service's port on loopback. SimulationError when no port is free.

    Delays are by the clock, the machine's by default; the same seed has the same befall the same datagrams.
    """
    tap = LinkTap(system_id, (HOST, service_port), clock or SystemClock(), seed)
    loop = asyncio.get_running_loop()
    try:
        transport, _ = await loop.create_datagram_endpoint(lambda: tap, local_addr=(HOST, 0))
    except OSError as error:
        raise SimulationError(f"no tap on the link at port {service_port} can be opened: {error}") from error
    try:
        yield tap
    finally:
        tap.lose_all()
        transport.close()
