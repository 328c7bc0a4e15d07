"""The processes of the link nodes' benchmark: many copters in one, a site's router, a node and the service.

`python -m tests.benchmarks.nodes_field WORD ARGUMENTS`, all of them JSON; each lasts until its parent ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import math
import os
import sys
from collections.abc import AsyncIterator
from itertools import permutations
from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh

from drivers.bus.session import BusEndpoint, LiveBus, open_bus
from drivers.clock import SystemClock
from drivers.errors import BusError
from drivers.process import until_told_to_stop
from drivers.simulation.autopilot import Autopilot
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.links import LinkAddress, UdpLink
from drivers.simulation.parameters import Parameters
from drivers.simulation.pump import Pump
from gcs import service
from gcs.nodes.link_node import LinkNode
from gcs.playbook.schema import Playbook
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from gcs.recording.run_folder import RunFolder
from gcs.recording.versions import versions
from gcs.simulated_vehicles import homes_of
from gcs.status import RunStatus
from planner.plan import RelayPlan, Route, plan_to_json
from planner.routes import make_leg, two_leg_routes

BASE_M: Final = 300.0
"""From L0 to L1."""
SPACING_M: Final = 20.0
SHIFT: Final = complex(3.0, 30.0)
"""From each start to its slot, m."""
AIR: Final = "10.77.0.1"
"""Where the copters are, for whoever has a radio."""
FIRST_PORT: Final = 15000
MOVING_MPS: Final = 0.3
LOOK_S: Final = 0.05


def playbook_of(vehicles: int, router: str) -> Playbook:
    """Return a relay of so many vehicles, every other one on the other node, in rows along L0 and L1."""
    receivers = [f"U{number}" for number in range(1, vehicles - 1)]
    columns = math.ceil(math.sqrt(len(receivers)))
    slots = {}
    for number, name in enumerate(receivers):
        row, column = divmod(number, columns)
        slots[name] = complex(BASE_M * 0.5 + SPACING_M * (column - (columns - 1) * 0.5), 0.5 * BASE_M + SPACING_M * row)
    uavs = ["L0", "L1", *receivers]
    return Playbook.model_validate(
        {
            "playbook": 1,
            "name": "nodes",
            "formation": {"kind": "custom", "slots": {f"O{n[1:]}": [at.real, at.imag] for n, at in slots.items()}},
            "transmitters": {"L0": {"at": [0.0, 0.0]}, "L1": {"at": [BASE_M, 0.0]}},
            "receivers": {n: {"start": [(at - SHIFT).real, (at - SHIFT).imag]} for n, at in slots.items()},
            "vehicles": {
                name: {
                    "link": f"udpout:{AIR}:{FIRST_PORT + number}",
                    "system_id": number,
                    "node": ("north", "south")[number % 2],
                }
                for number, name in enumerate(uavs, start=1)
            },
            "planner": {"min_separation_m": 5.0, "start_sigma_m": 2.0, "objective": "balanced"},
            "flight": {"altitude_m": 4.0, "speed_mps": 4.0, "give_up_s": 10.0},
            "bus": {"router": router, "insecure": True},
        }
    )


def plan_of(playbook: Playbook, waves: int) -> RelayPlan:
    """Return a plan by which all fly alike, row by row from the far end, in so many waves."""
    at = {name: transmitter.at for name, transmitter in playbook.transmitters.items()}
    slots = playbook.formation.points()
    pair = (("L0", at["L0"]), ("L1", at["L1"]))
    names = sorted(playbook.receivers, key=lambda name: -slots[f"O{name[1:]}"].imag)
    routes = []
    for order, name in enumerate(names):
        start, target = playbook.receivers[name].start, slots[f"O{name[1:]}"]
        first, second = min(permutations(pair), key=lambda guides: _length_m(start, target, guides))
        turning = _turning(start, target, (first, second))
        legs = make_leg(start, turning, first, pair), make_leg(turning, target, second, pair)
        wave = 1 + order * waves // len(names)
        routes.append(Route(name, f"O{name[1:]}", order, wave, "general", start, target, legs))
    return RelayPlan("bench", tuple(routes), 0.0, 0.0, 0.0)


def _turning(start: complex, target: complex, guides: Any) -> complex:
    return complex(two_leg_routes(start, target, guides[0][1], guides[1][1]).turning_point)


def _length_m(start: complex, target: complex, guides: Any) -> float:
    turning = _turning(start, target, guides)
    return abs(turning - start) + abs(target - turning)


@contextlib.asynccontextmanager
async def joined(endpoint: str) -> AsyncIterator[LiveBus]:
    """Join a bus whose router may take its time on a busy machine."""
    async with contextlib.AsyncExitStack() as stack:
        for left in reversed(range(240)):
            with contextlib.suppress(*((BusError,) if left else ())):
                bus = await stack.enter_async_context(open_bus(BusEndpoint(endpoint)))
                break
            await asyncio.sleep(0.5)
        yield bus


async def copters(told: dict[str, Any]) -> None:
    """Fly copters; write to a file who moves, as long as anybody does."""
    clock = SystemClock(told["speedup"], told["epoch_ns"])
    playbook = playbook_of(told["vehicles"], told["router"])
    autopilots: dict[str, Autopilot] = {}
    with contextlib.ExitStack() as opened:
        for number, (name, home) in enumerate(homes_of(playbook).items(), start=1):
            if number % told["of"] != told["part"]:
                continue
            parameters = Parameters()
            for key, value in {"SYSID_THISMAV": number, **told["parameters"]}.items():
                parameters.set(key, value)
            origin = GeoPoint(home.latitude_deg, home.longitude_deg, home.altitude_m)
            autopilots[name] = Autopilot(name, origin, parameters, boot_unix_ns=clock.unix_ns(), seed=number)
            link = opened.enter_context(contextlib.closing(UdpLink(LinkAddress("udpin", AIR, FIRST_PORT + number))))
            pump = Pump(autopilots[name], [link], clock)
            pump.start()
            opened.callback(pump.stop)
        gc.collect()
        gc.freeze()
        with Path(told["moving"]).open("w", buffering=1) as file:  # noqa: ASYNC230 - a line now and then
            looking = asyncio.ensure_future(_look(autopilots, clock, file))
            await until_told_to_stop(told["parent"])
            looking.cancel()


async def _look(autopilots: dict[str, Autopilot], clock: SystemClock, file: Any) -> None:
    """Write who moves, by name, with the speed over ground and the simulated time."""
    while True:
        await clock.sleep(LOOK_S)
        moving = {}
        for name, autopilot in autopilots.items():
            dynamics = autopilot.flight.dynamics
            speed_mps = math.hypot(dynamics.north.velocity_mps, dynamics.east.velocity_mps)
            if speed_mps > MOVING_MPS:
                moving[name] = round(speed_mps, 2)
        file.write(json.dumps([clock.unix_ns(), moving]) + "\n")


async def router(told: dict[str, Any]) -> None:
    """Route between those who connect here and the routers that this one connects to."""
    config = BusEndpoint(told["endpoints"][0], "router", insecure=True).configuration()
    config.insert_json5("listen/endpoints", json.dumps(told["endpoints"]))
    config.insert_json5("connect/endpoints", json.dumps(told["connect"]))
    with contextlib.closing(zenoh.open(config)):
        await until_told_to_stop(told["parent"])


async def node(told: dict[str, Any]) -> None:
    """Be a link node."""
    clock = SystemClock(told["speedup"], told["epoch_ns"])
    async with joined(told["connect"]) as bus:
        running = asyncio.ensure_future(
            LinkNode(told["name"], "nodes", bus, clock, lambda text: print(text, flush=True)).run()
        )
        told_to = asyncio.ensure_future(until_told_to_stop(told["parent"]))
        await asyncio.wait((running, told_to), return_when=asyncio.FIRST_COMPLETED)
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


async def fly(told: dict[str, Any]) -> None:
    """Be the service: the relay in the time of the copters, which a playbook of vehicles is not flown in otherwise."""
    playbook = playbook_of(told["vehicles"], told["router"])
    plan = plan_of(playbook, told["waves"])
    sim_time = service.SimulatedTime(told["speedup"], told["epoch_ns"])
    folder = RunFolder.create(Path(told["runs"]), playbook.name)
    folder.write_json("playbook.json", playbook.model_dump(mode="json"))
    folder.write_json("plan.json", plan_to_json(plan))
    facts = RunFacts(sim_time.epoch_ns, sim_time.speedup, playbook.seed, None, versions())
    folder.write_json(FACTS_FILE, msgspec.to_builtins(facts))
    options = service.RunOptions(Path(told["runs"]), attended=True)
    watching = asyncio.ensure_future(_end_with(told["parent"]))
    result = await service._serve(folder, folder.logs, playbook, plan, options, sim_time, None, _shown, None)
    watching.cancel()
    print(json.dumps({"outcome": result.report["outcome"]}), flush=True)


async def _end_with(parent: int) -> None:
    """End the service when its parent has ended."""
    while os.getppid() == parent:  # noqa: ASYNC110 - no event tells of it
        await asyncio.sleep(0.5)
    os._exit(1)


@contextlib.asynccontextmanager
async def _shown(status: RunStatus) -> AsyncIterator[None]:
    status.on_said.append(lambda said: print(f"{said.elapsed_s:.1f} {said.text}", flush=True))
    yield


WORDS: Final = {"copters": copters, "router": router, "node": node, "fly": fly}

if __name__ == "__main__":
    sys.setswitchinterval(0.0005)
    asyncio.run(WORDS[sys.argv[1]](json.loads(sys.argv[2]) | {"parent": os.getppid()}))
