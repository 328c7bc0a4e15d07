"""A run of one receiver: two legs, a verification and a trim leg, and all that a recording holds of them."""

from __future__ import annotations

import cmath
import json
import math
import random
from pathlib import Path

import numpy as np

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Bearing, BearingReport, Emission, Progress, encode
from gcs.bearings import BearingFeed, Observation
from gcs.guidance import SpeedLimits, leg_velocity
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.topics import message_on, monitor_topic
from gcs.stop_monitor import SLOT, TURN
from gcs.traced_monitor import MonitorNote, TracedMonitor
from planner.frames import FormationFrame
from planner.plan import Leg, RelayPlan, Route, plan_to_json
from planner.routes import make_leg
from tests.fakes import FAKE_UNIX_NS, ManualClock

KEYS = SwarmKeys("test")
FRAME = FormationFrame(math.radians(90.0))
PLACES = {"L0": 0j, "L1": 100 + 0j, "U7": -40 + 120j}
START, TURNING, TARGET = 30 + 40j, 48 + 64j, 60 + 48j
PERIOD_S, LAG_S = 0.1, 0.5
LIMITS = SpeedLimits()

Said = tuple[int, str, bytes]
"""Time, topic and payload of a message."""


def leg_between(start: complex, end: complex, guide: str) -> Leg:
    return make_leg(start, end, (guide, PLACES[guide]), (("L0", PLACES["L0"]), ("L1", PLACES["L1"])))


LEGS = (leg_between(START, TURNING, "L0"), leg_between(TURNING, TARGET, "L1"))


class Receiver:
    """U1: it answers velocity with a lag, its sensor has noise. `said` is everything recorded of it."""

    def __init__(self, sigma_deg: float = 0.2, seed: int = 1) -> None:
        self.clock = ManualClock()
        self.sigma_rad = math.radians(sigma_deg)
        self.place, self.velocity, self.command = START, 0j, 0j
        self.said: list[Said] = []
        self.monitor: TracedMonitor | None = None
        self._noise = random.Random(seed)
        self._feed = BearingFeed(["U1"], FRAME, self.clock, 0.5)
        self._reports = 0

    def say(self, topic: str, payload: bytes) -> None:
        self.said.append((self.clock.unix_ns(), topic, payload))

    def enter(self, state: str) -> None:
        self.say(KEYS.progress, encode(Progress(self.clock.unix_ns(), "U1", state, "")))

    def trace(self, note: MonitorNote) -> None:
        self.say(monitor_topic("U1"), encode(note))

    def make_monitor(self, leg: Leg) -> TracedMonitor:
        rule = SLOT if leg is LEGS[-1] else TURN
        sigma_m = {"U7": 0.1}
        arguments = (leg, PLACES, self.place, np.eye(2) * 0.25, self.clock.now_s(), rule, sigma_m)
        self.monitor = TracedMonitor(*arguments, tell=self.trace)
        return self.monitor

    def measure(self) -> Observation:
        """Measure now; the report is heard half a period later."""
        bearings = [
            Bearing(
                name, FRAME.azimuth_rad(cmath.phase(at - self.place)) + self._noise.gauss(0.0, self.sigma_rad), 0.003
            )
            for name, at in PLACES.items()
        ]
        bearings = [Bearing(b.transmitter, math.remainder(b.azimuth_rad, math.tau), b.sigma_rad) for b in bearings]
        report = encode(BearingReport(self.clock.unix_ns(), self._reports, "true_north", bearings))
        self._reports += 1
        self._move(PERIOD_S / 2)
        self.say(KEYS.bearings("U1"), report)
        self._feed.take(KEYS.bearings("U1"), report)
        return self._feed.latest["U1"]

    def fly(self) -> None:
        """Fly to the end of the leg, as a leg is flown."""
        monitor = self.monitor
        assert monitor is not None
        monitor.begin(self.clock.now_s())
        for _ in range(900):
            seen = self.measure()
            if len(monitor.observe(seen.captured_s, seen.directions_rad, seen.sigma_rad)) > 1:
                now = monitor.whereabouts(self.clock.now_s())
                if monitor.arrived(now):
                    break
                self._command(leg_velocity(now, LIMITS))
            self._move(PERIOD_S / 2)
        else:
            raise AssertionError("the leg did not end")
        self._command(0j)

    def verify(self, reports: int = 20) -> None:
        """Hover, and let the monitor hear for how long."""
        self._move(1.0)
        heard = []
        for _ in range(reports):
            heard.append(self.measure())
            self._move(PERIOD_S / 2)
        for seen in heard:
            self.monitor.observe(seen.captured_s, seen.directions_rad, seen.sigma_rad)

    def _command(self, velocity: complex) -> None:
        self.monitor.commanded(self.clock.now_s(), velocity)
        self.command = self.monitor.course * velocity

    def _move(self, duration_s: float) -> None:
        for _ in range(5):
            self.velocity += (self.command - self.velocity) * duration_s / 5 / LAG_S
            self.place += self.velocity * duration_s / 5
        self.clock.jump(duration_s)


def fly_run(seed: int = 1, *, trim: bool = True) -> list[Said]:
    """Return everything said in a run."""
    receiver = Receiver(seed=seed)
    for name in ("L0", "L1"):
        receiver.say(KEYS.emission(name), encode(Emission(on=True)))
    receiver.enter("LOCATING")
    for number, leg in enumerate(LEGS, start=1):
        receiver.enter(f"LEG_{number}")
        receiver.make_monitor(leg)
        receiver.fly()
    receiver.enter("VERIFYING")
    receiver.verify()
    if trim:
        receiver.enter("TRIMMING")
        receiver.fly()
        receiver.enter("VERIFYING")
        receiver.verify()
    receiver.enter("PLACED")
    receiver.say(KEYS.emission("L1"), encode(Emission(on=False)))
    return receiver.said


def write_run(folder: Path, said: list[Said], limits: SizeLimits | None = None) -> Path:
    """Write the folder of a run and return it."""
    files = McapFiles(folder, {}, limits or SizeLimits(), free_bytes=lambda _: 10**12)
    for time_ns, topic, payload in said:
        files.write(topic, message_on(topic), time_ns, payload)
    files.finish()
    route = Route("U1", "O1", 1, 1, "II", START, TARGET, LEGS)
    plan = plan_to_json(RelayPlan("test", (route,), 0.0, 0.0, 0.0))
    playbook = {"name": "test", "site": {"axis_azimuth_deg": 90.0}}
    facts = {"started_ns": FAKE_UNIX_NS - 10_000_000_000, "speedup": 1.0, "seed": 1, "sitl": None, "versions": {}}
    for name, data in (("plan", plan), ("playbook", playbook), ("run", facts)):
        (folder / f"{name}.json").write_text(json.dumps(data))
    return folder
