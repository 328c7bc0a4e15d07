"""Moves datagrams and time between an autopilot and its links, and sleeps in between."""

from __future__ import annotations

import asyncio
from math import inf

from drivers.clock import SystemClock
from drivers.simulation.autopilot import COMPONENT_ID, UNDERSTOOD, Autopilot
from drivers.simulation.links import UdpLink
from drivers.simulation.wire import Codec


class Pump:
    """Runs one autopilot on an asyncio loop: it wakes for a packet or when something is due, else not at all.

    `start` needs a running loop; `stop` takes everything off it and leaves the links open.
    """

    def __init__(self, autopilot: Autopilot, links: list[UdpLink], clock: SystemClock) -> None:
        self._autopilot = autopilot
        self._lines = [(link, autopilot.open_port(), Codec(UNDERSTOOD, COMPONENT_ID)) for link in links]
        self._clock = clock
        self._switched_on_s = clock.now_s()
        self._due_s = inf
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Begin to listen and to report."""
        loop = asyncio.get_running_loop()
        for index, (link, _, _) in enumerate(self._lines):
            loop.add_reader(link.socket, self._read, index)
        self._tick()

    def stop(self) -> None:
        """Fall silent."""
        loop = asyncio.get_running_loop()
        if self._timer:
            self._timer.cancel()
        for link, _, _ in self._lines:
            loop.remove_reader(link.socket)

    def _now_s(self) -> float:
        return self._clock.now_s() - self._switched_on_s

    def _read(self, index: int) -> None:
        link, port, codec = self._lines[index]
        for datagram in link.receive():
            for message in codec.decode(datagram):
                self._autopilot.receive(port, message, self._now_s())
        self._flush()

    def _tick(self) -> None:
        self._due_s = inf
        self._autopilot.advance(self._now_s())
        self._flush()

    def _flush(self) -> None:
        system_id = self._autopilot.vehicle.system_id
        for link, port, codec in self._lines:
            for message in port.take():
                link.send(codec.encode(message, system_id))
        self._sleep_until(self._autopilot.next_due_s)

    def _sleep_until(self, due_s: float) -> None:
        if due_s == self._due_s:
            return
        self._due_s = due_s
        if self._timer:
            self._timer.cancel()
        wall_s = max(0.0, due_s - self._now_s()) / self._clock.speedup
        self._timer = asyncio.get_running_loop().call_later(wall_s, self._tick)
