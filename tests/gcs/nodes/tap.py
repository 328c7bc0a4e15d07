"""A tap on the wire between one copter and whoever has its link: passes all on, and notes what matters."""

from __future__ import annotations

import asyncio
import math
import time

from drivers.mavlink.codec import Codec, FrameSplitter

HOST = "127.0.0.1"


class Tap(asyncio.DatagramProtocol):
    """Between a copter and a link at a port of this machine. Times are monotonic, s."""

    def __init__(self, system_id: int, link_port: int) -> None:
        self.system_id = system_id
        self.setpoints: list[float] = []
        """When each setpoint was sent to the copter, and..."""
        self.speeds: list[float] = []
        """...how fast it told it to fly, m/s."""
        self.kinematics: list[tuple[float, float]] = []
        """When the copter told how fast it flies, and that, m/s."""
        self._link = (HOST, link_port)
        self._copter: tuple[str, int] | None = None
        self._splitter, self._codec = FrameSplitter(), Codec()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.port = transport.get_extra_info("sockname")[1]

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        from_link = addr == self._link
        if not from_link:
            self._copter = addr
        if self._copter is not None:
            self.transport.sendto(data, self._copter if from_link else self._link)
        for frame in self._splitter.datagram(data):
            message = self._codec.decode(frame)
            if message is None:
                continue
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints.append(time.monotonic())
                self.speeds.append(math.hypot(message.vx, message.vy))
            elif message.get_type() == "GLOBAL_POSITION_INT":
                self.kinematics.append((time.monotonic(), math.hypot(message.vx, message.vy) * 0.01))

    def error_received(self, exc: Exception) -> None:
        """Nobody is at the port of the link now."""
