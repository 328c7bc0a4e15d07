"""A relay in virtual time whose service is killed: its journal and its vehicles are what is left of it."""

from __future__ import annotations

import asyncio
import copy
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.recording.journal import change_line, relay_line
from gcs.recording.journal_reading import entries_of
from gcs.relay.records import ReceiverRecord
from gcs.resume.beginning import go_on, silence
from gcs.resume.state import restored, run_state
from gcs.simulate.bus import LocalBus
from gcs.simulate.vehicle import SimulatedVehicle
from gcs.simulate.virtual_time import VirtualClock
from gcs.simulate.world import RelayWorld
from planner.plan import RelayPlan

LONGEST_S = 1500.0


@dataclass(frozen=True)
class Planned:
    """What is flown."""

    playbook: Playbook
    plan: RelayPlan


def planned(name: str) -> Planned:
    playbook = load_playbook(Path("sitl_configs") / f"{name}.yaml")
    return Planned(playbook, playbook.plan())


CHAIN = planned("paper_8")
"""The paper's eight, one after another, each guided by the one before."""
PLAYBOOK, PLAN = CHAIN.playbook, CHAIN.plan


@dataclass(frozen=True)
class LaterClock(VirtualClock):
    """Virtual time that goes on from when the loop before it ended."""

    began_s: float = 0.0

    def now_s(self) -> float:
        return self.began_s + super().now_s()


@dataclass
class CountedLease:
    """What one service does to a vehicle, counted."""

    vehicle: SimulatedVehicle
    renewals: int = 0

    @property
    def state(self) -> StreamState:
        return self.vehicle.state

    def renew(self, velocity_north_east_mps: complex) -> None:
        self.renewals += 1
        self.vehicle.renew(velocity_north_east_mps)

    def stop(self) -> None:
        self.vehicle.stop()

    def release(self) -> str | None:
        return self.vehicle.release()


@dataclass(frozen=True)
class Line:
    """One line of a journal, and when it was written."""

    time_s: float
    text: bytes


@dataclass(frozen=True)
class Left:
    """What is left of a killed service: the vehicles as they fly by themselves, who is on the air, and the journal."""

    time_s: float
    vehicles: Mapping[str, SimulatedVehicle]
    on_air: frozenset[str]
    lines: tuple[Line, ...]

    def journal(self, torn: float | None = None) -> list[bytes]:
        """The journal's lines; of the last one only this share, when it is torn."""
        lines = [line.text for line in self.lines]
        return lines if torn is None else [*lines[:-1], lines[-1][: int(torn * len(lines[-1]))]]


class ServedWorld(RelayWorld):
    """A world flown by one service. `found` is what a killed one before it left, and `journal` what can be read."""

    def __init__(
        self,
        found: Left | None = None,
        journal: Sequence[bytes] = (),
        later_s: float = 0.0,
        *,
        planned: Planned = CHAIN,
        attended: bool = False,
    ) -> None:
        clock = LaterClock(0.0 if found is None else found.time_s + later_s)
        self._found, self._clock_before = found, clock
        self._waits: list[tuple[int, float]] = []
        self._left: list[Left] = []
        super().__init__(planned.playbook, planned.plan, clock, LocalBus(), seed=7, attended=attended)
        self.read = entries_of(journal)
        self.restored = restored(planned.plan, run_state(self.read.entries))
        self.lines = [Line(-1.0, text) for text in journal]
        self.counted = {name: CountedLease(vehicle) for name, vehicle in self.vehicles.items()}
        for name in self.restored.withheld:
            self.vehicles[name].state = StreamState.PILOT
        self.executor = self.executor_of(
            self.restored.records, leases=self.counted, say=self._say, unverified=self.restored.unverified
        )
        self.score.records = self.executor.records
        if found is not None:
            self.on_air.update(found.on_air)
            silence(self.bus, self.keys, self.vehicles)
            go_on(self.executor, self.restored, self.announced)

    def make_vehicle(self, name: str, home: complex) -> SimulatedVehicle:
        if self._found is None:
            return super().make_vehicle(name, home)
        return _copied(self._found.vehicles[name], self._clock_before)

    def announced(self, record: ReceiverRecord) -> None:
        self._append(change_line(self.clock.unix_ns(), record))

    def states(self) -> dict[str, str]:
        return {name: record.state.value for name, record in self.executor.records.items()}

    async def left_after(self, waits: Sequence[tuple[int, float]]) -> list[Left]:
        """Fly to the end; what would be left if the service were killed so long after so many lines of its journal."""
        self._waits = list(waits)
        self._lay_in_wait()
        await self.run(LONGEST_S)
        await self.clock.sleep(1.0)
        return self._left

    def left(self) -> Left:
        """What is left if the service is killed now."""
        vehicles = {name: _copied(vehicle, self.clock) for name, vehicle in self.vehicles.items()}
        for vehicle in vehicles.values():
            if vehicle.state is not StreamState.PILOT:
                vehicle.state = StreamState.SILENT  # nobody is there to send the zero velocity at a lease's end
        return Left(self.clock.now_s(), vehicles, frozenset(self.on_air), tuple(self.lines))

    def _say(self, text: str) -> None:
        self.said.append(text)
        self._append(relay_line(self.clock.unix_ns(), text, self.executor.taken, self.executor.given_up))

    def _append(self, entry: dict) -> None:
        self.lines.append(Line(self.clock.now_s(), json.dumps(entry, allow_nan=False).encode()))
        self._lay_in_wait()

    def _lay_in_wait(self) -> None:
        for lines, later_s in self._waits:
            if lines == len(self.lines):
                asyncio.get_running_loop().call_later(later_s, lambda: self._left.append(self.left()))


def _copied(vehicle: SimulatedVehicle, clock: Clock) -> SimulatedVehicle:
    """The vehicle in the midst of what it was told last, by another clock of the same time."""
    flight, program = vehicle._flight, vehicle._flight._program
    flight._program = None  # a generator, which cannot be copied; guided flight has no other state
    try:
        copied = copy.deepcopy(vehicle, {id(vehicle._clock): clock})
    finally:
        flight._program = program
    copied._flight._program = copied._flight._programs[flight.mode]()
    return copied
