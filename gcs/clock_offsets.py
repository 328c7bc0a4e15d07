"""How far the sensors' clocks are off: estimated over the bus, by pings that a sensor answers with its clock.

Each exchange bounds the offset: the sensor's clock was read somewhere between the ping's departure and the pong's
arrival (the four timestamps of NTP). The exchange with the shortest round trip bounds it best, until drift has made it
worse than a newer one. Two bounds that exclude each other mean that the clock was set: what was known before is void.

Offsets are taken against this service's monotonic clock: a wall clock that is set on the ground moves no capture time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import BearingReport, ClockPing, ClockPong, MalformedMessageError, decode, encode
from drivers.bus.session import Bus
from drivers.clock import Clock

PING_EVERY_S: Final = 1.0
DRIFT_PER_S: Final = 200e-6
"""What two clocks may drift apart; twice what a poor crystal does."""

_WINDOW: Final = 30
_READING_S: Final = 1e-3
"""Clocks are read a little before and after the instant that is meant."""
_SOONEST_S: Final = 0.1
_PATIENCE: Final = 3
_WORTH_SAYING_S: Final = 0.05

Say = Callable[[str], None]


@dataclass(frozen=True)
class CaptureTime:
    """When a report was captured, as far as the sensor's clock is known."""

    age_s: float
    clock_uncertainty_s: float | None
    """None: nothing is known of that clock, and it is taken to be right."""
    times_set: int
    """How often that clock was seen to have been set: across a setting, its times are in no order."""


@dataclass(frozen=True)
class ClockEstimate:
    """What one exchange says of a clock. `ahead_ns`: its time since 1970 minus this service's monotonic time."""

    taken_s: float
    ahead_ns: int
    round_trip_s: float
    clock: str = ""

    def uncertainty_s(self, now_s: float) -> float:
        """Return how far off the estimate may be by now, s: a bound, as long as nobody sets the clock."""
        return self.round_trip_s / 2.0 + DRIFT_PER_S * (now_s - self.taken_s)

    def excludes(self, other: ClockEstimate, now_s: float) -> bool:
        """Return whether both cannot be true of one clock that nobody has set."""
        apart_s = abs(self.ahead_ns - other.ahead_ns) * 1e-9
        return apart_s > self.uncertainty_s(now_s) + other.uncertainty_s(now_s) + _READING_S


@dataclass
class SensorClock:
    """What is known of one sensor's clock."""

    best: ClockEstimate | None = None
    times_set: int = 0
    """How often it was seen to have been set."""
    unanswered: int = 0
    last_ping_s: float = float("-inf")
    complained: bool = False
    _asked: dict[int, float] = field(default_factory=dict)
    _recent: deque[ClockEstimate] = field(default_factory=lambda: deque(maxlen=_WINDOW))

    def ask(self, asked_ns: int, now_s: float) -> None:
        """Note a ping."""
        self.last_ping_s = now_s
        self.unanswered += 1
        self._asked[asked_ns] = now_s
        while len(self._asked) > _WINDOW:
            del self._asked[next(iter(self._asked))]

    def take(self, pong: ClockPong, now_s: float) -> float | None:
        """Take the answer to a ping in. Return by how much the clock was set since, s, or None."""
        asked_s = self._asked.pop(pong.asked_ns, None)
        if asked_s is None:
            return None  # nobody asked, or it was answered before
        answering_s = (pong.answered_ns - pong.received_ns) * 1e-9
        round_trip_s = now_s - asked_s - answering_s
        if answering_s < 0.0 or round_trip_s < 0.0:
            return None  # the clock was set between its two readings
        self.unanswered = 0
        middle_ns = round((asked_s + now_s) / 2.0 * 1e9)
        ahead_ns = (pong.received_ns + pong.answered_ns) // 2 - middle_ns
        newest, before = ClockEstimate(asked_s, ahead_ns, round_trip_s, pong.clock), self.best
        was_set = before is not None and (before.clock != newest.clock or newest.excludes(before, now_s))
        if was_set:
            self.times_set += 1
            self._recent.clear()
        self._recent.append(newest)
        self.best = min(self._recent, key=lambda estimate: estimate.uncertainty_s(now_s))
        return (ahead_ns - before.ahead_ns) * 1e-9 if before is not None and was_set else None


class ClockOffsets:
    """The clocks of all sensors; `say` gets what the operator should know, each once."""

    def __init__(self, receivers: Collection[str], clock: Clock, say: Say = lambda _: None) -> None:
        self.clocks = {name: SensorClock() for name in receivers}
        self._clock = clock
        self._say = say
        self._bus: Bus | None = None
        self._keys = SwarmKeys("")

    def attach(self, bus: Bus, keys: SwarmKeys) -> None:
        """Ask and listen on a bus from now on."""
        self.ask_on(bus, keys)
        bus.subscribe(keys.every_clock_pong, self.take)

    def ask_on(self, bus: Bus, keys: SwarmKeys) -> None:
        """Ask on a bus from now on; whoever listens there has `take` called."""
        self._bus, self._keys = bus, keys

    async def run(self) -> None:
        """Ask every sensor in turn, each once a round, until cancelled."""
        while self.clocks:
            for name in self.clocks:
                self._ping(name)
                await self._clock.sleep(PING_EVERY_S / len(self.clocks))

    def ask_again(self, receiver: str) -> None:
        """Ask a sensor that has answered before at once: its reports look as if its clock had been set."""
        known = self.clocks[receiver]
        if known.best is not None and self._clock.now_s() - known.last_ping_s >= _SOONEST_S:
            self._ping(receiver)

    def captured(self, receiver: str, report: BearingReport) -> CaptureTime:
        """Return when a report was captured, by this service's clock."""
        known = self.clocks[receiver]
        best = known.best
        if best is None or (report.clock and report.clock != best.clock):
            self._complain(receiver, known, report.clock)
            return CaptureTime((self._clock.unix_ns() - report.captured_ns) * 1e-9, None, known.times_set)
        now_s = self._clock.now_s()
        age_s = now_s - (report.captured_ns - best.ahead_ns) * 1e-9
        return CaptureTime(age_s, best.uncertainty_s(now_s), known.times_set)

    def offset_s(self, receiver: str) -> tuple[float, float] | None:
        """Return (how far a sensor's clock is ahead of this service's wall clock, uncertainty), s, for screens."""
        best, now_s = self.clocks[receiver].best, self._clock.now_s()
        if best is None:
            return None
        return (best.ahead_ns - (self._clock.unix_ns() - round(now_s * 1e9))) * 1e-9, best.uncertainty_s(now_s)

    def take(self, key: str, payload: bytes) -> None:
        """Take one answer as it comes off the bus; what is no answer is ignored."""
        receiver, now_s = uav_of(key), self._clock.now_s()
        if receiver is None or receiver not in self.clocks:
            return
        try:
            pong = decode(payload, ClockPong)
        except MalformedMessageError:
            return
        known = self.clocks[receiver]
        first = known.best is None
        step_s = known.take(pong, now_s)
        offset = self.offset_s(receiver)
        if step_s is not None:
            self._say(f"the clock of {receiver}'s sensor was set {_direction(step_s, 'forward', 'back')}")
        elif first and offset is not None and abs(offset[0]) > _WORTH_SAYING_S:
            self._say(
                f"the clock of {receiver}'s sensor is {_direction(offset[0], 'ahead', 'behind')}: taken into account"
            )

    def _complain(self, receiver: str, known: SensorClock, clock: str) -> None:
        """Say once that nothing is known of a clock that stamps reports, after giving it time to answer."""
        if known.complained or (known.best is None and known.unanswered <= _PATIENCE):
            return
        known.complained = True
        why = f"answers for the clock {known.best.clock!r}, not {clock!r}" if known.best else "answers no clock pings"
        self._say(f"the sensor of {receiver} {why}: its capture times are taken as they are")

    def _ping(self, receiver: str) -> None:
        if self._bus is None:
            return
        asked_ns = self._clock.unix_ns()
        self.clocks[receiver].ask(asked_ns, self._clock.now_s())
        self._bus.put_latest(self._keys.clock_ping(receiver), encode(ClockPing(asked_ns)), urgent=True)


def _direction(seconds: float, positive: str, negative: str) -> str:
    return f"{abs(seconds):.3f} s {positive if seconds > 0.0 else negative}"
