"""Real autopilots whose links are at a link node: a two-leg route, and a vehicle that obeys signed frames alone."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import os
import re
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from drivers.errors import SimulationError
from drivers.mavlink.codec import Codec
from drivers.simulation.sitl import SITLS, Sitl
from tests.gcs.field import Field, Wire, open_field
from tests.gcs.test_sitl_signing import KEY, VARIABLE, on_second_port, setup

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

LINK = re.compile(r"\{(link: 'udpin:[^}]*)\}")
ROUTER = re.compile(r"router: '([^']*)'")


class Node:
    """A link node that has every link of the field, in a process of its own."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.said = folder / "node.log"
        self._environment = {**os.environ, "XDG_STATE_HOME": str(folder / "node"), **environment}
        self._endpoint = ""

    def take_over(self, playbook: str) -> str:
        """Return the playbook with every vehicle on the node."""
        match = ROUTER.search(playbook)
        assert match is not None
        self._endpoint = match[1]
        return LINK.sub(r"{\1, node: north}", playbook)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run it while the block lasts."""
        words = ("-m", "gcs.cli", "link-node", "north", "--swarm", "field", "--connect", self._endpoint)
        with self.said.open("wb") as log:
            process = await asyncio.create_subprocess_exec(
                sys.executable, *words, stdout=log, stderr=log, env=self._environment
            )
        try:
            yield
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
