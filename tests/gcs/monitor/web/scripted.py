"""A run that is only told, not flown: setup, states and events as a service would publish them, by a script.

`python -m tests.gcs.monitor.web.scripted PORT RUNS_DIR` plays it on a bus of its own, to be looked at.
"""

from __future__ import annotations

import argparse
import asyncio
import cmath
import contextlib
import itertools
import json
import math
import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from drivers.bus.run_messages import (
    Alert,
    BearingState,
    Events,
    EventsRequest,
    LegSetup,
    LegState,
    LinkHealth,
    ReceiverStatus,
    RouteSetup,
    RunEvent,
    RunSetup,
    RunState,
    TransmitterSetup,
    VehicleState,
    decode_run,
)
from drivers.bus.session import BusEndpoint, open_bus
from gcs.monitor.access import COMMAND_VARIABLE, Token
from gcs.monitor.proven import ControlGuard

PERIOD_S = 0.2
PACE_S = 1.5
"""How long locating and verifying take."""
SPEED_MPS = 5.0


def place(point):
    return (point.real, point.imag)


def subtended(point, first, second):
    return cmath.phase((second - point) / (first - point))


def crossing(start, slot):
    """Return where the line from the start past L0 comes nearest to the slot: a turning point."""
    along = start / abs(start)
    return along * max((slot / along).real, 10.0)


def setup_of(receivers=8, radius_m=100.0, run="20261122-120000-scripted", together=1):
    """Return a circle of slots that `together` receivers at a time take up from scattered starts."""
    slots = {f"O{k}": cmath.rect(radius_m, 2 * math.pi * k / (receivers + 1)) for k in range(1, receivers + 1)}
    routes, at_s = [], 0.0
    for k, (slot, end) in enumerate(slots.items(), start=1):
        start = end * (0.45 + 0.1 * (k * 7 % 5)) * cmath.exp(1j * (0.25 - 0.1 * (k % 4)))
        turn = crossing(start, end)
        legs = [
            LegSetup("L0", "away", ("L0", "L1"), subtended(turn, 0, radius_m), place(start), place(turn)),
            LegSetup("L1", "towards", ("L0", "L1"), subtended(end, 0, radius_m), place(turn), place(end)),
        ]
        length_m = abs(turn - start) + abs(end - turn)
        ends_s = at_s + 2 * PACE_S + length_m / SPEED_MPS
        wave = (k - 1) // together + 1
        routes.append(RouteSetup(f"U{k}", slot, wave, "I", place(start), place(end), legs, at_s, ends_s))
        at_s = ends_s if k % together == 0 else at_s
    wide = 1.35 * radius_m
    return RunSetup(
        run=run,
        playbook="scripted",
        started_ns=time.time_ns(),
        latitude_deg=47.0,
        longitude_deg=8.0,
        altitude_m=400.0,
        axis_azimuth_rad=math.radians(60.0),
        slots={name: place(at) for name, at in slots.items()},
        transmitters=[
            TransmitterSetup("L0", (0.0, 0.0), beacon=False),
            TransmitterSetup("L1", (radius_m, 0.0), beacon=True),
        ],
        routes=routes,
        fence=[(-wide, -wide), (wide, -wide), (wide, wide), (-wide, wide)],
        min_separation_m=5.0,
        speed_mps=SPEED_MPS,
        flight_altitude_m=20.0,
        predicted_s=max(route.ends_s for route in routes),
        attended=True,
    )


@dataclass
class ScriptedRun:
    """The run at any moment of its own time; it can be held, resumed and aborted."""

    setup: RunSetup
    elapsed_s: float = 0.0
    number: int = 0
    held: str | None = None
    aborted: bool = False
    events: list[RunEvent] = field(default_factory=list)
    asked: list[ControlRequest] = field(default_factory=list)
    on_event: list = field(default_factory=list)
    states: dict[str, str] = field(default_factory=dict)
    since_s: dict[str, float] = field(default_factory=dict)
    paused_s: float = 0.0

    def __post_init__(self):
        self.say("preflight: every vehicle is ready")

    @property
    def formed(self):
        return len(self.states) > 0 and all(state == "PLACED" for state in self.states.values())

    def say(self, text, level="info", vehicle=None, state=None):
        event = RunEvent(
            self.setup.run,
            len(self.events),
            time.time_ns(),
            self.elapsed_s,
            text,
            level=level,
            vehicle=vehicle,
            state=state,
        )
        self.events.append(event)
        for listener in self.on_event:
            listener(event)

    def advance(self, duration_s):
        """Let the run's time pass, and return its state then."""
        self.elapsed_s += duration_s
        if self.held is not None or self.aborted:
            self.paused_s += duration_s
        self.number += 1
        receivers, vehicles = [], []
        for route in self.setup.routes:
            receiver, at, heading = self._receiver(route)
            receivers.append(receiver)
            vehicles.append(self._vehicle(receiver.name, len(vehicles) + 3, at, heading))
        standing = [
            self._vehicle(one.name, k + 1, complex(*one.at_m), 1.0)
            for k, one in enumerate(self.setup.transmitters)
            if not one.beacon
        ]
        moving = [receiver for receiver in receivers if receiver.leg]
        phase = "aborted" if self.aborted else "formed" if self.formed else "relay"
        return RunState(
            run=self.setup.run,
            number=self.number,
            time_ns=time.time_ns(),
            sent_ns=time.time_ns(),
            phase=phase,
            elapsed_s=self.elapsed_s,
            alerts=self._alerts(),
            held=self.held,
            waiting=self.held is not None,
            ways_out=["bearing-relay control resume", "bearing-relay control abort"] if self.held else [],
            to_go_s=None if self.held else max((receiver.to_go_s or 0.0 for receiver in receivers), default=0.0),
            on_air=["L0", "L1"] if moving else [],
            receivers=receivers,
            vehicles=[*standing, *vehicles],
            links=[
                LinkHealth(one.name, f"udpin:127.0.0.1:{14550 + k}", "up", 900, 300, 2, 0, 0, loss=0.002, silent_s=0.05)
                for k, one in enumerate([*standing, *vehicles])
            ],
            events=len(self.events),
        )

    def answer(self, payload):
        request = decode(payload, ControlRequest)
        self.asked.append(request)
        reply = self._carry_out(request)
        self.say(f"operator: {request.verb}: {reply.message}")
        return encode(reply)

    def answer_events(self, payload):
        first = decode_run(payload, EventsRequest).first
        return encode(Events(self.events[first:]))

    def _carry_out(self, request):
        if self.aborted:
            return ControlReply(ok=False, message="the relay has ended")
        if request.verb == "hold":
            self.held = "held by the operator"
            self.say(f"the relay holds: {self.held}", "alert")
            return ControlReply(ok=True, message="the relay is held; stopped: whoever flew")
        if request.verb == "resume":
            if self.held is None:
                return ControlReply(ok=False, message="nothing is held")
            self.held = None
            return ControlReply(ok=True, message="the relay goes on")
        if request.verb == "abort":
            self.aborted = True
            return ControlReply(ok=True, message="the relay ends; stopped: whoever flew")
        return ControlReply(ok=False, message=f"{request.vehicle} is the service's already")

    def _alerts(self):
        found = []
        if self.held is not None:
            way_out = "bearing-relay control resume or bearing-relay control abort"
            found.append(Alert("alert", "relay", f"holds: {self.held}", way_out))
        if 12.0 < self.elapsed_s < 20.0:
            text = "udpin:127.0.0.1:14553: 4 % lost"
            found.append(Alert("warning", "U2", text, "check antenna, range and power"))
        return found

    def _receiver(self, route):
        flown_s = self.elapsed_s - self.paused_s - route.begins_s
        points = [complex(*route.start_m), *(complex(*leg.end_m) for leg in route.legs)]
        lengths_s = [abs(b - a) / SPEED_MPS for a, b in itertools.pairwise(points)]
        state, leg, at, heading = "WAITING", None, points[0], 0.8
        if flown_s >= 0.0:
            state, at = "LOCATING", points[0]
        begins_s = PACE_S
        for number, (length_s, setup) in enumerate(zip(lengths_s, route.legs, strict=True), start=1):
            if begins_s <= flown_s:
                share = min((flown_s - begins_s) / length_s, 1.0)
                state, at = f"LEG_{number}", points[number - 1] + share * (points[number] - points[number - 1])
                heading = cmath.phase(points[number] - points[number - 1])
                leg = self._leg(number, setup, at, length_s * (1.0 - share))
            begins_s += length_s
        if flown_s >= begins_s:
            state, leg, at = "VERIFYING", None, points[-1]
        if flown_s >= begins_s + PACE_S:
            state = "PLACED"
        if self.held is not None and state in ("LOCATING", "LEG_1", "LEG_2", "VERIFYING"):
            state, leg = "HELD", None
        self._note(route, state)
        to_go_s = 0.0 if state == "PLACED" else max(begins_s + PACE_S - flown_s, 0.0)
        receiver = ReceiverStatus(
            route.receiver,
            route.slot,
            route.wave,
            state,
            self.since_s[route.receiver],
            reason="held by the operator" if state == "HELD" else "",
            bearings=BearingState(10 * self.number, {}, 0.11, math.radians(0.4), ["L0", "L1"]),
            leg=leg,
            legs=2,
            to_go_s=None if state == "HELD" else to_go_s,
            place_m=place(at),
            place_sigma_m=0.4,
        )
        return receiver, at, heading

    def _note(self, route, state):
        name = route.receiver
        if self.states.get(name) != state:
            self.states[name], self.since_s[name] = state, self.elapsed_s
            level = "alert" if state == "HELD" else "info"
            self.say(f"{name} {state}", level, vehicle=name, state=state)

    def _leg(self, number, setup, at, to_go_s):
        first, second = 0j, complex(*self.setup.transmitters[1].at_m)
        ahead = complex(*setup.end_m) - complex(*setup.start_m)
        step = ahead / abs(ahead) * 0.1
        angle = subtended(at, first, second)
        rate = (subtended(at + step, first, second) - angle) / 0.1 * SPEED_MPS
        return LegState(
            number,
            setup.guide,
            setup.direction,
            setup.stop_reference,
            setup.stop_angle_rad,
            setup.start_m,
            setup.end_m,
            band_rad=math.radians(0.4),
            band_m=0.5,
            angle_rad=angle + math.radians(0.2) * math.sin(self.elapsed_s * 9.0),
            rate_radps=rate,
            remaining_m=to_go_s * SPEED_MPS,
            cross_track_m=0.3 * math.sin(self.elapsed_s),
            progress_mps=SPEED_MPS,
            sigma_m=0.3,
            to_go_s=to_go_s,
        )

    def _vehicle(self, name, system_id, at, heading):
        return VehicleState(
            name,
            system_id,
            transmits=name == "L0",
            at_m=place(at),
            height_m=20.1,
            velocity_mps=(0.0, 0.0),
            heading_rad=heading,
            mode="GUIDED",
            armed=True,
            battery_percent=88,
            battery_v=15.9,
            estimator="good",
            silent_s=0.08,
            nearest="L0",
            nearest_m=abs(at) or 40.0,
        )


async def play(endpoint, runs_dir, run, speed=1.0, stop=None):
    """Publish a run on a router of its own until `stop` is set, as a service would, and say where it is."""
    keys = SwarmKeys(run.setup.playbook)
    async with open_bus(BusEndpoint(endpoint, role="router")) as bus:
        folder = Path(runs_dir) / run.setup.run
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "bus.json").write_text(json.dumps({"endpoint": endpoint, "swarm": run.setup.playbook}))
        bus.put_reliably(keys.setup, encode(run.setup))
        token = os.environ.get(COMMAND_VARIABLE)
        guard = ControlGuard(run.setup.playbook, run.answer, Token(token) if token else None)
        bus.serve(keys.control, guard.take)
        bus.serve(keys.events, run.answer_events)
        run.on_event.append(lambda event: bus.put_latest(keys.events, encode(event)))
        while stop is None or not stop.is_set():
            bus.put_latest(keys.state, encode(run.advance(PERIOD_S * speed)))
            await asyncio.sleep(PERIOD_S)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("port", type=int)
    parser.add_argument("runs_dir", type=Path)
    parser.add_argument("--receivers", type=int, default=8)
    parser.add_argument("--together", type=int, default=1)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--ahead-s", type=float, default=0.0)
    parser.add_argument("--run", default="20261122-120000-scripted")
    arguments = parser.parse_args()

    async def until_told():
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        run = ScriptedRun(setup_of(arguments.receivers, run=arguments.run, together=arguments.together))
        for _ in range(int(arguments.ahead_s / PERIOD_S)):
            run.advance(PERIOD_S)
        endpoint = f"tcp/127.0.0.1:{arguments.port}"
        await play(endpoint, arguments.runs_dir, run, arguments.speed, stop)

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(until_told())


if __name__ == "__main__":
    main()
