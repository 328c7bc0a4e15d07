"""Real autopilots whose links are at a link node: a two-leg route, and a vehicle that obeys signed frames alone."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import os
import re
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from drivers.errors import SimulationError
from drivers.mavlink.autopilots import ardupilot, px4
from drivers.mavlink.codec import Codec
from drivers.simulation.sitl import SITLS, Sitl
from tests.gcs.field import Field, Wire, open_field
from tests.gcs.test_sitl_signing import KEY, VARIABLE, on_second_port, setup

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

LINK = re.compile(r"(\w+): \{(link: 'udpin:[^}]*)\}")
ROUTER = re.compile(r"router: '([^']*)'")


class Node:
    """A link node that has links of the field, all unless vehicles are named, in a process of its own."""

    def __init__(self, folder: Path, environment: dict[str, str], name: str = "north", only: str = r"\w+") -> None:
        self.said = folder / f"{name}.log"
        self._environment = {**os.environ, "XDG_STATE_HOME": str(folder / name), **environment}
        self._endpoint, self._name, self._only = "", name, only

    def take_over(self, playbook: str) -> str:
        """Return the playbook with its vehicles on the node."""
        match = ROUTER.search(playbook)
        assert match is not None
        self._endpoint = match[1]

        def on_node(vehicle: re.Match[str]) -> str:
            ours = re.fullmatch(self._only, vehicle[1])
            return f"{vehicle[1]}: {{{vehicle[2]}, node: {self._name}}}" if ours else vehicle[0]

        return LINK.sub(on_node, playbook)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[asyncio.subprocess.Process]:
        """Run it while the block lasts."""
        words = ("-m", "gcs.cli", "link-node", self._name, "--swarm", "field", "--connect", self._endpoint)
        with self.said.open("wb") as log:
            process = await asyncio.create_subprocess_exec(
                sys.executable, *words, stdout=log, stderr=log, env=self._environment
            )
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            await process.wait()


async def flown(
    folder: Path,
    sitl: Sitl,
    node: Node,
    change: Callable[[str], str] = str,
    ready: Callable[[dict[str, Wire]], Awaitable[None]] | None = None,
) -> Field:
    """Fly the field with its links at a node, and return it as it was at the end."""
    async with contextlib.AsyncExitStack() as stack:

        async def before(wires: dict[str, Wire]) -> None:
            if ready is not None:
                await ready(wires)
            await stack.enter_async_context(node.running())

        field = await stack.enter_async_context(
            open_field(folder, sitl, change=lambda text: change(node.take_over(text)), before=before)
        )
        status = await field.ended(200.0)
        print("\n".join(field.lines), node.said.read_text(), sep="\n--- node\n")
        assert status == 0, field.said()
        return field


def require(name: str) -> Sitl:
    try:
        SITLS[name].find()
    except SimulationError as error:
        pytest.skip(str(error))
    return SITLS[name]


def require_formed(field: Field) -> None:
    receiver = field.report()["receivers"][0]
    print(f"placement error {receiver['placement_error_m']:.2f} m in {len(receiver['legs'])} legs")
    assert receiver["state"] == "PLACED"
    assert receiver["placement_error_m"] < 1.0
    assert len(receiver["legs"]) == 2


@pytest.mark.parametrize(
    "autopilot",
    [
        pytest.param("ardupilot", marks=pytest.mark.sitl_ardupilot),
        pytest.param("px4", marks=pytest.mark.sitl_px4),
    ],
)
async def test_a_two_leg_route_forms_through_a_node(autopilot: str, tmp_path: Path) -> None:
    require_formed(await flown(tmp_path, require(autopilot), Node(tmp_path, {})))


@pytest.mark.sitl_ardupilot
async def test_a_node_signs_with_the_key_that_the_playbook_names_and_it_alone_has(tmp_path: Path) -> None:
    sitl = dataclasses.replace(require("ardupilot"), command=on_second_port)
    assert VARIABLE not in os.environ

    async def switched_on(wires: dict[str, Wire]) -> None:
        for wire in wires.values():
            setup(wire, KEY, Codec())
        await asyncio.sleep(1.0)
        for wire in wires.values():
            wire.signed[True].clear()
            wire.signed[False].clear()

    def with_key(playbook: str) -> str:
        return f"{playbook}mavlink: {{signing: {{key_variable: {VARIABLE}}}}}\n"

    field = await flown(tmp_path, sitl, Node(tmp_path, {VARIABLE: KEY.hex()}), with_key, switched_on)
    require_formed(field)
    for name, wire in field.wires.items():
        print(f"{name}: node {dict(wire.signed[True])}, vehicle {dict(wire.signed[False])} (signed: frames)")
        assert wire.signed[True][True] > 50
        assert wire.signed[True][False] == wire.signed[False][False] == 0


@pytest.mark.parametrize(
    ("autopilot", "guided", "asked"),
    [
        pytest.param("ardupilot", ardupilot.MODE_GUIDED, (1, 4), marks=pytest.mark.sitl_ardupilot),
        pytest.param("px4", px4.MODE_OFFBOARD, (1, 6), marks=pytest.mark.sitl_px4),
    ],
)
async def test_a_killed_node_s_vehicle_stops_leaves_its_mode_by_itself_and_is_flown_on_by_another_with_consent(
    autopilot: str, guided: int, asked: tuple[int, ...], tmp_path: Path
) -> None:
    north, south = Node(tmp_path, {}, "north", only="U1"), Node(tmp_path, {}, "south", only=r"L\d")
    async with contextlib.AsyncExitStack() as stack:
        processes: list[asyncio.subprocess.Process] = []

        async def before(_wires: dict[str, Wire]) -> None:
            processes.extend([await stack.enter_async_context(node.running()) for node in (north, south)])

        def on_both(playbook: str) -> str:
            return south.take_over(north.take_over(playbook)).replace("altitude_m: 4", "altitude_m: 8")

        flying = open_field(tmp_path, require(autopilot), ("--attended",), on_both, before=before)
        field = await stack.enter_async_context(flying)
        wire = field.wire
        await field.until_moving()
        await field.until(lambda: wire.kinematics[-1][2] > 1.0, 10.0)
        processes[0].kill()
        killed_s = time.monotonic()
        await field.until(lambda: wire.kinematics[-1][2] < 0.3, 10.0)
        print(f"stopped {wire.kinematics[-1][0] - killed_s:.2f} s after its node was killed")
        await field.until(
            lambda: wire.modes[-1][1] != guided, 10.0
        )  # it lands without a station, or holds without a stream
        assert max(wire.setpoints) < killed_s + 0.2  # nobody speaks for it before the operator does
        await until_ok(field, "takeover", "north")
        await field.until(lambda: "U1 PILOT" in field.said(), 10.0)
        assert max(wire.setpoints) < killed_s + 0.2  # nor who has it now: it has left its guided mode
        assert (
            "its node was asked" in (await field.say("release", "U1")).message
        )  # a PX4 enters OFFBOARD on a stream only
        await asyncio.sleep(1.0)
        wire.command(*asked)
        await field.until(lambda: wire.modes[-1][1] == guided, 5.0)
        await field.say("release", "U1")
        await field.until(lambda: "U1 HELD: released" in field.said(), 5.0)
        await until_ok(field, "resume")
        status = await field.ended(200.0)
        print("\n".join(field.lines))
        assert status == 0, field.said()
        receiver = field.report()["receivers"][0]
        print(f"placement error {receiver['placement_error_m']:.2f} m")
        assert receiver["state"] == "PLACED"
        assert receiver["placement_error_m"] < 1.0


async def until_ok(field: Field, verb: str, vehicle: str | None = None) -> None:
    """Say a word until it is done: the service may still be busy with what happened."""
    async with asyncio.timeout(20.0):
        while not (reply := await field.say(verb, vehicle)).ok:
            print(f"{verb}: {reply.message}")
            await asyncio.sleep(0.2)
