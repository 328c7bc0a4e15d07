"""What the state of a run is told from: everything that screens may see, and nothing that they could change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

from drivers.bus.run_messages import BearingState, BusHealth, Histogram, RecordingHealth, RunSetup
from drivers.mavlink.vehicle import Vehicle
from gcs.bearings import BearingFeed
from gcs.monitor.timing import Pace
from gcs.safety import PositionBoard
from gcs.status import RunStatus
from planner.angles import wrap
from planner.frames import FormationFrame

_NO_BEARINGS = BearingState()


@dataclass
class RunSources:
    """The parts of a run that its state is told from. The run fills in what comes later: the feed of bearings."""

    setup: RunSetup
    status: RunStatus
    frame: FormationFrame
    pace: Pace
    board: PositionBoard = field(default_factory=PositionBoard)
    vehicles: Mapping[str, Vehicle] = field(default_factory=dict)
    bus_connected: Callable[[], bool] = lambda: True
    recording: Callable[[], RecordingHealth] = RecordingHealth
    decisions: Callable[[], Histogram | None] = lambda: None
    feed: BearingFeed | None = None
    on_air: Callable[[], AbstractSet[str]] | None = None
    """Tells who transmits now; without it that is what the status says."""
    headings_rad: Mapping[str, float] = field(default_factory=dict)
    """Azimuths of the noses of those vehicles that tell them."""
    plan_setup: Callable[[], RunSetup] = field(init=False)
    """Returns the setup in force: another one once the run flies another plan."""
    transmitters: dict[str, complex] = field(init=False)
    """The places of those that transmit from the start, formation frame, m."""

    def __post_init__(self) -> None:
        self.plan_setup = lambda: self.setup
        self.transmitters = {each.name: complex(*each.at_m) for each in self.setup.transmitters}

    def transmitting(self) -> AbstractSet[str]:
        """Return who is on the air."""
        return self.status.on_air if self.on_air is None else self.on_air()

    def place_of(self, transmitter: str) -> complex | None:
        """Return where a transmitter stands or will stand, formation frame, m; None when nobody can tell."""
        record = self.status.records.get(transmitter)
        if record is None:
            return self.transmitters.get(transmitter)
        return record.route.target if record.place is None else record.place

    def bearings(self, receiver: str) -> BearingState:
        """Return what is known of a receiver's bearing reports."""
        counters = None if self.feed is None else self.feed.by_receiver.get(receiver)
        if self.feed is None or counters is None:
            return _NO_BEARINGS
        dropped = {name: count for name, count in vars(counters).items() if name != "received" and count}
        latest = self.feed.latest.get(receiver)
        if latest is None:
            return BearingState(counters.received, dropped)
        return BearingState(
            received=counters.received,
            dropped=dropped,
            age_s=max(self.status.clock.now_s() - latest.captured_s, 0.0),
            sigma_rad=max(latest.sigma_rad.values(), default=None),
            heard=list(latest.directions_rad),
        )

    def bus(self) -> BusHealth:
        """Return how the bus fares."""
        strangers = 0 if self.feed is None else self.feed.counters.unknown_sender
        return BusHealth(self.bus_connected(), strangers)

    def heading_rad(self, vehicle: str) -> float | None:
        """Return where a vehicle's nose points: polar, formation frame; None when it does not tell."""
        azimuth_rad = self.headings_rad.get(vehicle)
        return None if azimuth_rad is None else wrap(self.frame.azimuth_rad(azimuth_rad))
