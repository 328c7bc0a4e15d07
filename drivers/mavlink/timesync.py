"""How far an autopilot's clock is from this service's, by TIMESYNC.

An answer holds the autopilot's time since boot at a moment between question and answer: the quickest of several tells
most. Over loopback ArduCopter 4.6.3 answers in 0.2 to 7.5 ms (its loop), PX4 1.17 in 0.04 ms (its clock ticks 4 ms).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Message
from drivers.mavlink.vehicle import Vehicle

PERIOD_S: Final = 1.0


@dataclass(frozen=True)
class ClockOffset:
    """What to add to an autopilot's time since boot for the time since 1970 here, and how long the best answer took."""

    offset_ns: int
    round_trip_s: float

    @property
    def uncertainty_s(self) -> float:
        """The largest error of the offset, s, however unevenly the two ways took."""
        return self.round_trip_s / 2.0


async def measure_clock(vehicle: Vehicle, questions: int = 3) -> ClockOffset | None:
    """Ask once a PERIOD_S and return the offset by the quickest answer; None when none came."""
    clock = vehicle.clock
    asked_s: dict[int, float] = {}
    answers: list[ClockOffset] = []

    def take(message: Message) -> None:
        if message.tc1 != 0 and message.ts1 in asked_s:
            round_trip_s = clock.now_s() - asked_s.pop(message.ts1)
            halfway_ns = message.ts1 + round(round_trip_s * 5e8)
            answers.append(ClockOffset(halfway_ns - message.tc1, round_trip_s))

    with vehicle.hearing(mavlink.MAVLINK_MSG_ID_TIMESYNC, take):
        for _ in range(questions):
            now_ns = clock.unix_ns()
            asked_s[now_ns] = clock.now_s()
            vehicle.link.post(mavlink.MAVLink_timesync_message(0, now_ns))
            await clock.sleep(PERIOD_S)
    return min(answers, key=lambda answer: answer.round_trip_s, default=None)
