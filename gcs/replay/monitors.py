"""One stop monitor of a run, told once more what it was told then: what it decides now, beside what was recorded."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.relay.leg_filter import Whereabouts
from gcs.replay.settings import Changes, changed, kind_of
from gcs.stop_monitor import StopMonitor
from gcs.traced_monitor import Asked, MonitorNote, Observed, SetUp


@dataclass(frozen=True)
class Stop:
    """A decision to stop: after how many samples of the flight, when, and where that brings the receiver to rest."""

    sample: int
    time_ns: int
    at_rest: complex


@dataclass
class Flight:
    """One flight along a leg: from the moment it began until the next thing. `what` says which leg it is.

    `replayed` is the stop by the settings of the replay. `difference` says where, by those of the flight, the replay
    was first not what was recorded. A sample is a report taken in. Places are where the receiver would come to rest by
    the settings of the flight, along the leg from its end and to the left of it, m.
    """

    receiver: str
    what: str
    began_ns: int
    samples: int = 0
    recorded: Stop | None = None
    replayed: Stop | None = None
    last_at_rest: complex | None = None
    """When the replay was last asked."""
    difference: str | None = None
    largest_difference_m: float = 0.0
    """Of where the receiver was found to be, between replay and record: rounding, or else an explanation."""

    @property
    def identical(self) -> bool:
        """Whether every decision was reproduced."""
        return self.difference is None

    def decided(self, time_ns: int, at_rest: complex, *, arrived: bool) -> None:
        """Note what the replay decides now; a stop is for good."""
        if self.replayed is None:
            self.last_at_rest = at_rest
            self.replayed = Stop(self.samples, time_ns, at_rest) if arrived else None

    def differs(self, how: str) -> None:
        """Note what is not as it was; only the first counts."""
        if self.difference is None:
            self.difference = how


@dataclass
class MonitorReplay:
    """A monitor made again. `take` its notes in the order they were recorded."""

    receiver: str
    made: SetUp
    time_s: float
    changes: Changes
    flights: list[Flight] = field(default_factory=list)
    now: Whereabouts | None = None
    """Where the receiver was found to be last, by the settings of the flight."""
    _next: int = 1
    _stuck: bool = False
    _zero_ns: int = 0
    """The time since 1970 at which the monitor's clock showed zero."""

    def __post_init__(self) -> None:
        self.monitor = self.made.monitor(self.time_s)
        self._changed: StopMonitor | None = None
        if self.changes:
            self._changed = changed(self.made, self.changes).monitor(self.time_s)

    def take(self, note: MonitorNote, time_ns: int) -> None:
        """Have the monitors do what the note says, recorded at `time_ns`."""
        if self._stuck:
            return
        if note.number != self._next:
            self._give_up(f"note {note.number} follows note {self._next - 1}: some are not in the recording", time_ns)
            return
        self._next += 1
        if note.begun:
            self._begin(note.time_s, time_ns)
        elif note.observed is not None:
            self._observe(note.time_s, note.observed, time_ns)
        elif note.asked is not None:
            self._ask(note.time_s, note.asked, time_ns)
        elif note.commanded_mps is not None:
            for monitor in self._monitors:
                monitor.commanded(note.time_s, complex(*note.commanded_mps))

    @property
    def _monitors(self) -> tuple[StopMonitor, ...]:
        return (self.monitor,) if self._changed is None else (self.monitor, self._changed)

    def _begin(self, time_s: float, time_ns: int) -> None:
        for monitor in self._monitors:
            monitor.begin(time_s)
        what = "trim" if self.flights else kind_of(self.made.rule)
        self.flights.append(Flight(self.receiver, f"{what} {self.made.direction} {self.made.guide}", time_ns))

    def _flight(self, time_ns: int) -> Flight:
        """Return what is being flown."""
        if not self.flights:
            self._begin(self.time_s, time_ns)
        return self.flights[-1]

    def _observe(self, captured_s: float, told: Observed, time_ns: int) -> None:
        flight = self._flight(time_ns)
        flight.samples += 1
        report = (captured_s, told.directions_rad, told.sigma_rad, told.resolution_rad)
        agreeing = sorted(self.monitor.observe(*report))
        if self._changed is not None:
            self._changed.observe(*report)
        if agreeing != told.agreeing:
            flight.differs(f"sample {flight.samples}: {_names(agreeing)} agree, recorded {_names(told.agreeing)}")
        if flight.recorded is not None and self._changed is not None and len(agreeing) > 1:
            now = self.monitor.whereabouts(captured_s)
            arrived = self._changed.arrived(self._changed.whereabouts(captured_s))
            flight.decided(self._zero_ns + round(captured_s * 1e9), now.at_rest, arrived=arrived)

    def _ask(self, time_s: float, answered: Asked, time_ns: int) -> None:
        flight = self._flight(time_ns)
        self._zero_ns = time_ns - round(time_s * 1e9)
        now = self.now = self.monitor.whereabouts(time_s)
        arrived = self.monitor.arrived(now)
        off_m = max(abs(now.seen - complex(*answered.seen_m)), abs(now.at_rest - complex(*answered.at_rest_m)))
        flight.largest_difference_m = max(flight.largest_difference_m, off_m)
        if arrived is not answered.arrived:
            flight.differs(f"sample {flight.samples}: {_word(arrived)}, recorded {_word(answered.arrived)}")
        if answered.arrived and flight.recorded is None:
            flight.recorded = Stop(flight.samples, time_ns, complex(*answered.at_rest_m))
        if self._changed is not None:
            arrived = self._changed.arrived(self._changed.whereabouts(time_s))
        flight.decided(time_ns, now.at_rest, arrived=arrived)

    def _give_up(self, why: str, time_ns: int) -> None:
        self._stuck = True
        self._flight(time_ns).differs(why)


def _names(names: list[str]) -> str:
    return ", ".join(names) or "nobody"


def _word(arrived: bool) -> str:
    return "stop" if arrived else "no stop"
