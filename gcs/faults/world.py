"""A relay's world in which things fail at drawn moments, with an observer and recorders in it, perhaps an operator."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from zlib import crc32

from drivers.bus.keys import uav_of
from drivers.bus.messages import BearingReport, decode
from drivers.clock import Clock
from drivers.tasks import background
from gcs.faults.bus import FaultyBus
from gcs.faults.fault import LYING, OF_THE_LINK, Fault
from gcs.faults.kept.run import KeptRun
from gcs.faults.moments import OF_THE_SERVICE, Moments
from gcs.faults.observer import BRAKING_S, MustStop, Observer, Rules, Sight
from gcs.faults.operator import operate
from gcs.faults.sensor import FaultySensor
from gcs.faults.striking import FOR_ALL, FOR_WHO_FLIES, OWN_TIME_OUT_S, Plant, stop_within_s, switch
from gcs.faults.vehicle import FaultyVehicle
from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.separation import braking_way
from gcs.simulate.virtual_time import VirtualTimeLoop
from gcs.simulate.world import RelayWorld
from gcs.simulated_vehicles import weather_of
from gcs.traced_monitor import MonitorNote
from planner.plan import RelayPlan

_LOOK_S: Final = 0.05
_TOO_NEAR_SHARE: Final = 0.8
_OLDEST_REPORT_S: Final = 0.5
_STANDING_MPS: Final = 0.5
_DONE: Final = ("PLACED", "FAILED")
_MANY: Final = 5
_WHOLE_EACH: Final = 4
"""Of one run in so many everything is recorded, of the others the journal alone, which takes no time to speak of."""


class _KilledError(Exception):
    """The service was killed."""


class FaultyWorld(RelayWorld):
    """A world with faults. Attended, an operator gives vehicles back, resumes the relay twice, and aborts it then."""

    vehicles: dict[str, FaultyVehicle]
    kept: KeptRun
    """The records of its run, while it runs."""

    def __init__(
        self,
        playbook: Playbook,
        plan: RelayPlan,
        clock: Clock,
        seed: int,
        faults: Sequence[Fault],
        *,
        attended: bool = False,
    ) -> None:
        self.observer = Observer(_rules(playbook), set(playbook.receivers))
        self.moments = Moments(faults)
        self.wrong_placements = 0
        self.doubted_placements = 0
        """Those of them whose legs' monitors had refused directions again and again."""
        self.router = FaultyBus(clock, seed)
        self._from_north = playbook.sensor.reference == "true_north"
        self._measured_s = -1.0
        self.killed = False
        """Whether the service was killed."""
        super().__init__(playbook, plan, clock, self.router, seed=seed, attended=attended)
        self.executor = self.executor_of(self.executor.records, leases=self.vehicles, say=self._say)
        self._attended = attended
        self._safety = replace(self._safety, battery_percent=lambda name: self.vehicles[name].battery_percent)
        self._faulty = {
            name: FaultySensor(sensor.model, random.Random(f"{seed}/{name}"), f"{seed}/{name}")  # noqa: S311 - noise
            for name, sensor in self.sensors.items()
        }
        self.sensors.update(self._faulty)
        self._plant = Plant(self.vehicles, self._faulty, self.router)
        self.router.subscribe(self.keys.every_bearings, self._see_report)

    def make_vehicle(self, name: str, home: complex) -> FaultyVehicle:
        """Return a UAV in the air above `home` that can fail."""
        plain = super().make_vehicle(name, home)
        return FaultyVehicle(
            plain.place,
            self.playbook.flight.altitude_m,
            self.limits,
            self.clock,
            weather_of(self.playbook),
            crc32(f"{self.seed}/{name}/failing".encode()),
            plain.heading_rad,
            partial(self._see_command, name),
        )

    async def run(self, limit_s: float) -> None:
        """Run the relay to its end, watched and recorded."""
        clock, records, board = self.clock, self.executor.records, self.score.board
        with TemporaryDirectory(prefix="bearing-relay-") as folder:
            whole = self.seed % _WHOLE_EACH == 0
            self.kept = KeptRun(Path(folder), clock, self.bus, self.keys, records, board, self.frame, whole=whole)
            try:
                await self._run_watched(limit_s)
            finally:
                self.kept.close(partial(self._miss, clock.now_s()))

    async def _run_watched(self, limit_s: float) -> None:
        operating = [operate(self.executor, self.vehicles, self.observer, self.clock)] if self._attended else []
        async with background(self._watch(), *operating):
            try:
                await super().run(limit_s)
            except* _KilledError:
                pass
            self.observer.ended = True
            await self.hover(BRAKING_S + (OWN_TIME_OUT_S if self.killed else 2.0))
        for name, vehicle in self.vehicles.items():
            brakes = vehicle.goes_on_since_s > self.clock.now_s() - BRAKING_S
            strays = vehicle.piloted or name in self.moments.astray()
            obeys = not (strays or brakes or (vehicle.cut and not self.killed))
            if obeys and self.observer.speed_mps(name) > self.observer.rules.standing_mps:
                what = f"{self.observer.speed_mps(name):.2f} m/s after the relay's end"
                self.observer.findings.add("stopped", name, self.clock.now_s(), what)

    def measure(self) -> None:
        """Let fail what is due, then let every sensor measure, unless they have measured just now."""
        self._strike_and_mend()
        if self._measured_s < self.clock.now_s():
            self._measure()

    def _measure(self) -> None:
        self._measured_s = self.clock.now_s()
        silent = {name: self.score.board.latest.get(name) for name, v in self.vehicles.items() if not v.heard}
        super().measure()
        board = self.score.board.latest
        board.update({name: told for name, told in silent.items() if told is not None})
        for name, vehicle in self.vehicles.items():
            if vehicle.impaired:
                place, velocity = vehicle.told
                board[name] = replace(board[name], north_east=place, braking_way=braking_way(velocity))
        self.router.repeat()

    def announced(self, record: ReceiverRecord) -> None:
        """Record what is told, and see a new state."""
        self.kept.announced(record)
        name, now_s, state = record.name, self.clock.now_s(), record.state.value
        if self.observer.states.get(name) == state:
            return
        self.moments.entered(name, state, now_s)
        vehicle = self.vehicles[name]
        vehicle.advance()
        number = int(state[-1]) - 1 if state.startswith("LEG") else -1
        leg_m = record.route.legs[number].length_m if record.route.legs else 0.0
        self.observer.told(name, now_s, state, vehicle.place, leg_m)
        if state == "PLACED":
            slots = {route.receiver: self.frame.to_site(route.target) for route in self.plan.routes}
            given = {other: self.frame.to_site(at.at) for other, at in self.playbook.transmitters.items()}
            wrong = self.observer.placed(
                name,
                now_s,
                (slots[name], abs(vehicle.place - slots[name])),
                given | slots,
                self.sensors[name].model.sigma_rad,
                lied_to=self.observer.lied_to,
                from_north=self._from_north,
            )
            self.wrong_placements += wrong
            self.doubted_placements += wrong and sum(leg.outliers for leg in record.legs) >= _MANY

    def traced(self, receiver: str, note: MonitorNote) -> None:
        """Record what a stop monitor was told or answered."""
        self.kept.traced(receiver, note)

    def _say(self, text: str) -> None:
        self.said.append(text)
        self.kept.said(text, self.executor.taken, self.executor.given_up)

    def _miss(self, now_s: float, name: str, what: str) -> None:
        self.observer.findings.add("recorded", name, now_s, what)

    async def _watch(self) -> None:
        while True:
            self._look()
            self.kept.look()
            await self.clock.sleep(_LOOK_S)

    def _look(self) -> None:
        self.places()
        sights = {
            name: Sight(v.place, v.command, v.piloted, name in self.moments.astray(), v.heard and not v.impaired)
            for name, v in self.vehicles.items()
        }
        self.observer.look(self.clock.now_s(), sights)

    def _see_command(self, name: str, velocity: complex) -> None:
        self.observer.commanded(name, self.clock.now_s(), velocity, piloted=self.vehicles[name].piloted)

    def _see_report(self, key: str, payload: bytes) -> None:
        if (name := uav_of(key)) is not None:
            report = decode(payload, BearingReport)
            age_s = (self.clock.unix_ns() - self._faulty[name].captured_ns[report.sequence]) * 1e-9
            self.observer.reported(name, self.clock.now_s(), self.clock.now_s() - age_s, report)

    def _strike_and_mend(self) -> None:
        for fault, begins in self.moments.due(self.clock.now_s(), ended=self.observer.ended):
            if begins:
                self.observer.lied_to |= fault.kind in LYING
                self._strike(fault, self.clock.now_s())
            else:
                switch(self._plant, fault, on=False)

    def _strike(self, fault: Fault, now_s: float) -> None:
        """Let a fault begin, and the observer know who must stop for it."""
        flying = {name for name, vehicle in self.vehicles.items() if vehicle.command}
        if fault.kind not in OF_THE_SERVICE:
            switch(self._plant, fault, on=True)
        cut = self.killed or any(other.kind in ("link_cut", *OF_THE_LINK) for other in self.moments.faults)
        told = self.observer.states.get(fault.target)
        within_s = stop_within_s(
            fault, self.on_air, self.limits.lease_s, done=told in _DONE, cut=cut, from_north=self._from_north
        )
        if within_s is not None:
            self._require_stop(fault, now_s, within_s, flying)
        if fault.kind in OF_THE_SERVICE:
            self._stop_service(fault.for_s)

    def _require_stop(self, fault: Fault, now_s: float, within_s: float, flying: set[str]) -> None:
        names = set(self.vehicles) if fault.kind in FOR_ALL else {fault.target}
        if fault.kind in FOR_WHO_FLIES:
            names &= flying
        names -= {name for name, vehicle in self.vehicles.items() if vehicle.piloted}  # how a pilot stops is his affair
        until_s = float("inf") if fault.for_s is None else now_s + fault.for_s
        self.observer.stops.append(MustStop(names, now_s + within_s + BRAKING_S, until_s, fault.kind))

    def _stop_service(self, for_s: float | None) -> None:
        """Let the whole service stand still for so long: nothing leaves, and what comes waits. None: it was killed."""
        obeying = [vehicle for vehicle in self.vehicles.values() if not vehicle.cut]
        for vehicle in obeying:
            vehicle.cut_link(cut=True)
        self.observer.stops = [self._stopped_late(stop, for_s) for stop in self.observer.stops]
        if for_s is None:
            self.killed = True
            self.kept.kill()
            raise _KilledError
        loop, until_s = asyncio.get_running_loop(), self.clock.now_s() + for_s
        assert isinstance(loop, VirtualTimeLoop)  # noqa: S101 - no other can stand still
        while self.clock.now_s() < until_s:
            loop.stall(_LOOK_S)
            self._look()
            if self.clock.now_s() >= self._measured_s + 1.0 / self.playbook.sensor.rate_hz:
                self._measure()
        for vehicle in obeying:
            vehicle.cut_link(cut=False)

    def _stopped_late(self, stop: MustStop, for_s: float | None) -> MustStop:
        """Return when who has not been stopped yet stops under a service that stands still: later, or by itself."""
        now_s = self.clock.now_s()
        if stop.from_s - BRAKING_S <= now_s:
            return stop
        by_itself_s = max(stop.from_s, now_s + OWN_TIME_OUT_S + BRAKING_S)
        return replace(stop, from_s=by_itself_s if for_s is None else min(by_itself_s, stop.from_s + for_s))


def _rules(playbook: Playbook) -> Rules:
    return Rules(
        lease_s=playbook.flight.lease_s,
        oldest_report_s=_OLDEST_REPORT_S,
        speed_mps=playbook.flight.speed_mps,
        too_near_m=_TOO_NEAR_SHARE * playbook.planner.min_separation_m,
        tolerance_m=playbook.flight.placement_tolerance_m,
        standing_mps=_STANDING_MPS + playbook.simulation.gusts_mps,
    )
