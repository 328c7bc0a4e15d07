"""A run on the bench: real playbooks, plans and verdicts in virtual time, and vehicles that only take notes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.clock import Clock
from drivers.errors import VehicleError
from drivers.mavlink.setpoints import StreamState
from drivers.tasks import open_background
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.fleet import Member
from gcs.playbook.loader import load_playbook
from gcs.playbook.stages import Inject
from gcs.recording.run_folder import RunFolder
from gcs.recording.score import Score
from gcs.relay.emission import EmissionControl
from gcs.relay.records import ReceiverRecord
from gcs.safety import PositionBoard, SitePosition
from gcs.stages.flow import run_stages
from gcs.stages.operator import Operator
from gcs.stages.run import Run
from gcs.stages.simulation import End
from gcs.status import RunStatus
from tests.fakes import FakeBus, ManualClock

HEAD = """\
playbook: 1
name: bench
formation: {kind: custom, slots: {O1: [70, 60], O2: [20, 90]}}
transmitters: {L0: {at: [0, 0]}, L1: {at: [100, 0]}}
receivers: {U1: {start: [60, 30]}, U2: {start: [20, 50]}}
"""
GUIDED, PILOTED, RETURNING, HELD = 4, 5, 6, 17


class FakeVehicle:
    """A vehicle by its heartbeats: the mode it is in, and whether it is armed."""

    def __init__(self, name: str, clock: Clock) -> None:
        self.name = name
        self.clock = clock
        self.mode, self.armed = 0, False
        self.on_heartbeat: list[Callable[[Any], None]] = []

    @property
    def custom_mode(self) -> int:
        return self.mode

    @property
    def telemetry(self) -> SimpleNamespace:
        return SimpleNamespace(
            heartbeat=SimpleNamespace(custom_mode=self.mode, armed=self.armed, time_s=0.0), battery=None
        )

    def enter(self, mode: int) -> None:
        """Be in a mode, and tell."""
        self.mode = mode
        for listener in list(self.on_heartbeat):
            listener(self.telemetry.heartbeat)

    def silent_for_s(self) -> float:
        return 0.0


class FakeStream:
    """A stream that knows only whose the vehicle is and whether it moves."""

    def __init__(self) -> None:
        self.state = StreamState.SILENT
        self.stops = 0

    def renew(self, velocity: complex) -> None:
        self.state = StreamState.LEASED

    def stop(self) -> None:
        self.stops += 1
        if self.state is not StreamState.PILOT:
            self.state = StreamState.STOPPING


class FakeAutopilot:
    """Does what it is told after a while, and notes it; `refuses` are the words it refuses of a vehicle."""

    name = "bench autopilot"

    def __init__(self) -> None:
        self.told: list[str] = []
        self.refuses: set[str] = set()
        self.lasts_s = 2.0

    def is_guided(self, heartbeat: Any) -> bool:
        return heartbeat.custom_mode == GUIDED

    async def arm(self, vehicle: FakeVehicle) -> None:
        await self._do("arm", vehicle)
        vehicle.armed = True

    async def take_off(self, vehicle: FakeVehicle, altitude_m: float) -> None:
        vehicle.armed = True
        vehicle.enter(GUIDED)
        await self._do("take_off", vehicle)

    def hold(self, vehicle: FakeVehicle) -> None:
        self.told.append(f"hold {vehicle.name}")
        vehicle.enter(HELD)

    async def land(self, vehicle: FakeVehicle) -> None:
        await self._do("land", vehicle)
        vehicle.armed = False

    async def return_home(self, vehicle: FakeVehicle) -> None:
        vehicle.enter(RETURNING)
        await self._do("return", vehicle)
        vehicle.armed = False

    async def _do(self, word: str, vehicle: FakeVehicle) -> None:
        self.told.append(f"{word} {vehicle.name}")
        await vehicle.clock.sleep(self.lasts_s)
        if f"{word} {vehicle.name}" in self.refuses:
            raise VehicleError(vehicle.name, "bench", f"{word} refused", "See why.")


class Bench:
    """A run whose stages are given as YAML; the fleet stands in guided flight where `flying`."""

    def __init__(
        self, folder: Path, stages: str, more: str = "", *, attended: bool = False, flying: bool = True
    ) -> None:
        path = folder / "bench.yaml"
        path.write_text(HEAD + more + "stages:\n" + "".join(f"  - {line}\n" for line in stages.strip().splitlines()))
        self.playbook = load_playbook(path)
        self.clock, self.bus, self.autopilot = ManualClock(), FakeBus(), FakeAutopilot()
        self.vehicles = {name: FakeVehicle(name, self.clock) for name in self.playbook.uavs}
        self.journal: list[dict[str, Any]] = []
        plan, keys, frame = self.playbook.plan(), SwarmKeys("bench"), self.playbook.site.frame
        records = {route.receiver: ReceiverRecord(route) for route in plan.routes}
        status, board = RunStatus("bench", self.clock), PositionBoard()
        board.latest = {
            name: SitePosition(0.0, frame.to_site(start), 20.0) for name, start in self.playbook.uavs.items()
        }
        fleet: Any = SimpleNamespace(vehicles=self.vehicles)
        journal: Any = SimpleNamespace(append=self.journal.append)
        self.struck: list[str] = []
        simulation: Any = SimpleNamespace(strike=self._strike)
        clocks = ClockOffsets(self.playbook.receivers, self.clock)
        self.run = Run(
            playbook=self.playbook, plan=plan, values={}, clock=self.clock, bus=self.bus, folder=RunFolder(folder),
            journal=journal, status=status, fleet=fleet, board=board, clocks=clocks,
            feed=BearingFeed(self.playbook.receivers, frame, self.clock, 0.5, clocks),
            emission=EmissionControl(self.bus, keys, self.clock), records=records, score=Score(frame, board, records),
            operator=Operator(status.say, attended), simulation=simulation,
        )  # fmt: skip
        if flying:
            self.take_off()

    def take_off(self) -> None:
        """Have every vehicle in guided flight, as after its take-off."""
        self.run.autopilots = dict.fromkeys(self.vehicles, self.autopilot)  # type: ignore[arg-type]
        for name, vehicle in self.vehicles.items():
            vehicle.mode, vehicle.armed = GUIDED, True
            member: Any = Member(vehicle, self.autopilot, FakeStream())  # type: ignore[arg-type]
            self.run.members[name] = member

    async def fly(self, for_s: float = 300.0, meanwhile: Callable[[float], None] = lambda _: None) -> None:
        """Run the stages to their end, all but the preflight and the take-off that every playbook names first."""
        stages = [stage for stage in self.playbook.flow if stage.kind not in ("preflight", "takeoff")]
        await self.fly_stages(stages, for_s, meanwhile)

    async def fly_stages(
        self, stages, for_s: float = 300.0, meanwhile: Callable[[float], None] = lambda _: None
    ) -> None:
        """Run some stages to their end; `meanwhile` is called with the time since the start before each step."""

        async def flown() -> None:
            async with open_background() as self.run.start:
                await run_stages(self.run, stages)

        flying, began_s = asyncio.ensure_future(flown()), self.clock.now_s()
        while not flying.done():
            assert self.clock.now_s() - began_s < for_s, "the stages did not end"
            meanwhile(self.clock.now_s() - began_s)
            await self.clock.advance(0.1)
        await flying

    def speak(self, verb: Any, vehicle: str | None = None) -> ControlReply:
        """Say a word as over the bus, and return the answer."""
        return decode(self.run.operator.answer(encode(ControlRequest(verb, vehicle))), ControlReply)

    def outcomes(self) -> dict[str, str]:
        """What became of the stages, by name."""
        return {result.name: result.outcome for result in self.run.results}

    def said(self) -> str:
        return " ".join(text for _, text in self.run.status.messages)

    async def _strike(self, stage: Inject) -> End:
        self.struck.append(f"{stage.fault} {stage.vehicle} at {self.clock.now_s() - 100.0:.1f}")

        async def end() -> None:
            self.struck.append(f"over at {self.clock.now_s() - 100.0:.1f}")

        return end
