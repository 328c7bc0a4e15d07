"""A relay's world in which things fail at drawn moments, with an observer in it and perhaps an operator."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final
from zlib import crc32

from drivers.bus.keys import uav_of
from drivers.bus.messages import BearingReport, decode
from drivers.clock import Clock
from drivers.tasks import background
from gcs.faults.bus import FaultyBus
from gcs.faults.fault import LYING, Fault
from gcs.faults.observer import BRAKING_S, MustStop, Observer, Rules, Sight
from gcs.faults.sensor import FaultySensor
from gcs.faults.striking import FOR_ALL, FOR_WHO_FLIES, Plant, stop_within_s, switch
from gcs.faults.vehicle import FaultyVehicle
from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.simulate.world import RelayWorld
from gcs.simulated_vehicles import weather_of
from planner.plan import RelayPlan

_LOOK_S: Final = 0.05
_TOO_NEAR_SHARE: Final = 0.8
_OLDEST_REPORT_S: Final = 0.5
_STANDING_MPS: Final = 0.5
_DONE: Final = ("PLACED", "FAILED")
_MANY: Final = 5
_OPERATOR_S: Final = 4.0
_RESUMED: Final = 2


class FaultyWorld(RelayWorld):
    """A world with faults. Attended, an operator gives vehicles back, resumes the relay twice, and aborts it then."""

    vehicles: dict[str, FaultyVehicle]

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
        self.struck: dict[int, float] = {}
        """When each fault that has struck did so, by its number."""
        self.wrong_placements = 0
        self.doubted_placements = 0
        """Those of them whose legs' monitors had refused directions again and again."""
        self.router = FaultyBus(clock, seed)
        self._faults = faults
        self._from_north = playbook.sensor.reference == "true_north"
        self._mended: set[int] = set()
        self._moments: dict[tuple[str, str], float] = {}
        super().__init__(playbook, plan, clock, self.router, seed=seed, attended=attended)
        self._attended = attended
        self._safety = replace(self._safety, bus_connected=self.router.connected)
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
        """Run the relay to its end, watched."""
        async with background(self._watch(), self._operate()):
            await super().run(limit_s)
            self.observer.ended = True
            await self.hover(BRAKING_S + 2.0)
        for name, vehicle in self.vehicles.items():
            obeys = not (vehicle.piloted or vehicle.adrift or vehicle.cut)
            if obeys and self.observer.speed_mps(name) > self.observer.rules.standing_mps:
                what = f"{self.observer.speed_mps(name):.2f} m/s after the relay's end"
                self.observer.findings.add("stopped", name, self.clock.now_s(), what)

    def measure(self) -> None:
        """Let fail what is due, then let every sensor measure."""
        self._strike_and_mend()
        silent = {name: self.score.board.latest.get(name) for name, v in self.vehicles.items() if not v.heard}
        super().measure()
        self.score.board.latest.update({name: told for name, told in silent.items() if told is not None})
        self.router.repeat()

    def announced(self, record: ReceiverRecord) -> None:
        """See a state told."""
        name, now_s, state = record.name, self.clock.now_s(), record.state.value
        if self.observer.states.get(name) == state:
            return
        self._moments.setdefault((name, state), now_s)
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
                lied_to=any(self._faults[number].kind in LYING for number in self.struck),
                from_north=self._from_north,
            )
            self.wrong_placements += wrong
            self.doubted_placements += wrong and sum(leg.outliers for leg in record.legs) >= _MANY

    async def _watch(self) -> None:
        while True:
            self.places()
            sights = {
                name: Sight(v.place, v.command, v.piloted, name in self._astray(), v.heard)
                for name, v in self.vehicles.items()
            }
            self.observer.look(self.clock.now_s(), sights)
            await self.clock.sleep(_LOOK_S)

    async def _operate(self) -> None:
        """Do what an operator does who wants his formation: what has a pilot is given back, and the relay resumed."""
        resumed = 0
        while self._attended:
            await self.clock.sleep(_OPERATOR_S)
            if not self.executor.waiting:
                continue
            if resumed == _RESUMED:
                self.executor.abort("the operator gives up")
                continue
            for name in self.executor.blocking():
                self.vehicles[name].give_back()
                self.vehicles[name].release()
            self.executor.look()
            self.observer.stops.clear()
            self.executor.resume()
            resumed += 1

    def _astray(self) -> set[str]:
        """Return who has drifted, or drifts."""
        struck = (self._faults[number] for number in self.struck)
        return {fault.target for fault in struck if fault.kind == "transmitter_drift"}

    def _see_command(self, name: str, velocity: complex) -> None:
        self.observer.commanded(name, self.clock.now_s(), velocity, piloted=self.vehicles[name].piloted)

    def _see_report(self, key: str, payload: bytes) -> None:
        if (name := uav_of(key)) is not None:
            report = decode(payload, BearingReport)
            age_s = (self.clock.unix_ns() - self._faulty[name].captured_ns[report.sequence]) * 1e-9
            self.observer.reported(name, self.clock.now_s(), self.clock.now_s() - age_s, report)

    def _strike_and_mend(self) -> None:
        now_s = self.clock.now_s()
        for number, fault in enumerate(self._faults):
            entered_s = self._moments.get((fault.at.receiver, fault.at.state))
            if entered_s is None or number in self._mended:
                continue
            if number not in self.struck:
                if now_s >= entered_s + fault.at.after_s:
                    self.struck[number] = now_s
                    self._strike(fault, now_s)
            elif fault.for_s is not None and now_s >= self.struck[number] + fault.for_s:
                self._mended.add(number)
                switch(self._plant, fault, on=False)

    def _strike(self, fault: Fault, now_s: float) -> None:
        """Let a fault begin, and the observer know who must stop for it."""
        flying = {name for name, vehicle in self.vehicles.items() if vehicle.command}
        switch(self._plant, fault, on=True)
        cut = any(other.kind == "link_cut" for other in self._faults)
        told = self.observer.states.get(fault.target)
        within_s = stop_within_s(
            fault, self.on_air, self.limits.lease_s, done=told in _DONE, cut=cut, from_north=self._from_north
        )
        if within_s is None:
            return
        names = set(self.vehicles) if fault.kind in FOR_ALL else {fault.target}
        if fault.kind in FOR_WHO_FLIES:
            names &= flying
        names -= {name for name, vehicle in self.vehicles.items() if vehicle.piloted}  # how a pilot stops is his affair
        until_s = float("inf") if fault.for_s is None else now_s + fault.for_s
        self.observer.stops.append(MustStop(names, now_s + within_s + BRAKING_S, until_s, fault.kind))


def _rules(playbook: Playbook) -> Rules:
    return Rules(
        lease_s=playbook.flight.lease_s,
        oldest_report_s=_OLDEST_REPORT_S,
        speed_mps=playbook.flight.speed_mps,
        too_near_m=_TOO_NEAR_SHARE * playbook.planner.min_separation_m,
        tolerance_m=playbook.flight.placement_tolerance_m,
        standing_mps=_STANDING_MPS + playbook.simulation.gusts_mps,
    )
