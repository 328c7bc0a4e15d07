"""Answers for a sensor's clock: a ClockPing comes in, a ClockPong goes out, so that the ground learns the offset."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import ClockPing, ClockPong, MalformedMessageError, decode, encode
from drivers.bus.session import Bus

ReadClock = Callable[[], int]
"""Returns the time since 1970-01-01 UTC by the clock that stamps the sensor's reports, ns."""


def answer_clock_pings(bus: Bus, keys: SwarmKeys, clocks: Mapping[str, ReadClock], name: str = "") -> None:
    """Answer the clock pings to these UAVs from now on, each from its own clock; malformed ones are ignored."""

    def answer(key: str, payload: bytes) -> None:
        uav = uav_of(key)
        if uav is None or uav not in clocks:
            return
        received_ns = clocks[uav]()
        try:
            ping = decode(payload, ClockPing)
        except MalformedMessageError:
            return
        pong = ClockPong(ping.asked_ns, received_ns, clocks[uav](), name)
        bus.put_latest(keys.clock_pong(uav), encode(pong), urgent=True)

    bus.subscribe(keys.clock_ping(*clocks) if len(clocks) == 1 else keys.every_clock_ping, answer)
