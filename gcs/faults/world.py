"""A relay's world in which things fail at drawn moments, with an observer in it and perhaps an operator."""

from __future__ import annotations

import asyncio
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
from gcs.faults.fault import LYING, OF_THE_LINK, Fault
from gcs.faults.observer import BRAKING_S, MustStop, Observer, Rules, Sight
from gcs.faults.sensor import FaultySensor
from gcs.faults.striking import FOR_ALL, FOR_WHO_FLIES, OWN_TIME_OUT_S, Plant, stop_within_s, switch
from gcs.faults.vehicle import FaultyVehicle
from gcs.playbook.schema import Playbook
from gcs.relay.records import ReceiverRecord
from gcs.simulate.virtual_time import VirtualTimeLoop
from gcs.simulate.world import RelayWorld
from gcs.simulated_vehicles import weather_of
from planner.plan import RelayPlan

_LOOK_S: Final = 0.05
_TOO_NEAR_SHARE: Final = 0.8
_OLDEST_REPORT_S: Final = 0.5
_STANDING_MPS: Final = 0.5
_DONE: Final = ("PLACED", "FAILED")
_MANY: Final = 5
_OF_THE_SERVICE: Final = frozenset({"service_stopped", "service_killed"})
_OPERATOR_S: Final = 4.0
_RESUMED: Final = 2


class _KilledError(Exception):
    """The service was killed."""


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
        self._measured_s = -1.0
        self.killed = False
        """Whether the service was killed."""
        self._moments: dict[tuple[str, str], float] = {}
        super().__init__(playbook, plan, clock, self.router, seed=seed, attended=attended)
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
        """Run the relay to its end, watched."""
        async with background(self._watch(), self._operate()):
            try:
                await super().run(limit_s)
            except* _KilledError:
                self.killed = True
            self.observer.ended = True
            await self.hover(BRAKING_S + (OWN_TIME_OUT_S if self.killed else 2.0))
        for name, vehicle in self.vehicles.items():
            brakes = vehicle.goes_on_since_s > self.clock.now_s() - BRAKING_S
            strays = vehicle.piloted or name in self._astray()
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
        board.update({n: replace(board[n], north_east=v.told_place) for n, v in self.vehicles.items() if v.impaired})
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
                lied_to=self.observer.lied_to,
                from_north=self._from_north,
            )
            self.wrong_placements += wrong
            self.doubted_placements += wrong and sum(leg.outliers for leg in record.legs) >= _MANY

    async def _watch(self) -> None:
        while True:
            self._look()
            await self.clock.sleep(_LOOK_S)

    def _look(self) -> None:
        self.places()
        sights = {
            name: Sight(v.place, v.command, v.piloted, name in self._astray(), v.heard and not v.impaired)
            for name, v in self.vehicles.items()
        }
        self.observer.look(self.clock.now_s(), sights)

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
            if self.observer.ended and fault.kind in _OF_THE_SERVICE:
                continue
            if number not in self.struck:
                if now_s >= entered_s + fault.at.after_s:
                    self.struck[number] = now_s
                    self.observer.lied_to |= fault.kind in LYING
                    self._strike(fault, now_s)
            elif fault.for_s is not None and now_s >= self.struck[number] + fault.for_s:
                self._mended.add(number)
                if fault.kind not in _OF_THE_SERVICE:
                    switch(self._plant, fault, on=False)

    def _strike(self, fault: Fault, now_s: float) -> None:
        """Let a fault begin, and the observer know who must stop for it."""
        flying = {name for name, vehicle in self.vehicles.items() if vehicle.command}
        if fault.kind not in _OF_THE_SERVICE:
            switch(self._plant, fault, on=True)
        cut = any(other.kind in ("link_cut", *OF_THE_LINK) for other in self._faults)
        told = self.observer.states.get(fault.target)
        within_s = stop_within_s(
            fault, self.on_air, self.limits.lease_s, done=told in _DONE, cut=cut, from_north=self._from_north
        )
        if within_s is not None:
            self._require_stop(fault, now_s, within_s, flying)
        if fault.kind in _OF_THE_SERVICE:
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
        if for_s is None:
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


def _rules(playbook: Playbook) -> Rules:
    return Rules(
        lease_s=playbook.flight.lease_s,
        oldest_report_s=_OLDEST_REPORT_S,
        speed_mps=playbook.flight.speed_mps,
        too_near_m=_TOO_NEAR_SHARE * playbook.planner.min_separation_m,
        tolerance_m=playbook.flight.placement_tolerance_m,
        standing_mps=_STANDING_MPS + playbook.simulation.gusts_mps,
    )
