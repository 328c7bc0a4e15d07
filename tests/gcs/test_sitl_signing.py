"""Signed links with a real ArduCopter, on a port where it refuses what is not signed: switched on, flown, and off."""

from __future__ import annotations

import asyncio
import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import SystemClock
from drivers.errors import SimulationError
from drivers.mavlink.codec import Codec
from drivers.mavlink.signing import open_signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.simulation.sitl import SITLS, SitlCommand, SitlVehicle
from tests.gcs.field import Field, Wire, open_field

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400), pytest.mark.sitl_ardupilot]

ROOT = Path(__file__).parents[2]
KEY = bytes(range(1, 33))
VARIABLE = "FIELD_SIGNING_KEY"
NOBODY = "udpclient:127.0.0.1:9"


def on_second_port(program: Path, vehicle: SitlVehicle, folder: Path) -> SitlCommand:
    """Return the command with the link on SERIAL1: the first port takes unsigned frames whatever happens."""
    command = SITLS["ardupilot"].command(program, vehicle, folder)
    words = list(command.arguments)
    link = words[words.index("--serial0") + 1]
    words[words.index("--serial0") + 1], words[words.index("--serial1") + 1] = NOBODY, link
    return dataclasses.replace(command, arguments=tuple(words))


def setup(wire: Wire, key: bytes, codec: Codec) -> None:
    """Give a vehicle a key, or with a key of zeros none."""
    stamp = SigningClock(SystemClock()).now() if any(key) else 0
    wire.send(codec.encode(mavlink.MAVLink_setup_signing_message(wire.system_id, 1, key, stamp)))


def check(field: Field, *, signed: bool) -> tuple[int, str]:
    """Run the check before a flight, with the key or without; return its exit status and what it said."""
    text = field.playbook.read_text().replace("start: [20, 30]", "start: [70, 60]")  # it has flown to its slot
    path = field.playbook.with_name("check.yaml")
    path.write_text(text if signed else text.partition("mavlink:")[0])
    ran = subprocess.run(
        [sys.executable, "-m", "gcs.cli", "check", str(path)],
        capture_output=True, text=True, timeout=90, check=False, cwd=ROOT,
    )  # fmt: skip
    return ran.returncode, ran.stdout + ran.stderr


async def test_a_signed_fleet_flies_obeys_nobody_else_and_can_be_unsigned_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    try:
        SITLS["ardupilot"].find()
    except SimulationError as error:
        pytest.skip(str(error))
    monkeypatch.setenv(VARIABLE, KEY.hex())
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    sitl = dataclasses.replace(SITLS["ardupilot"], command=on_second_port)

    async def switched_on(wires: dict[str, Wire]) -> None:
        for wire in wires.values():
            setup(wire, KEY, Codec())
        await asyncio.sleep(1.0)
        for wire in wires.values():
            wire.signed[True].clear()
            wire.signed[False].clear()

    def with_key(playbook: str) -> str:
        return f"{playbook}mavlink: {{signing: {{key_variable: {VARIABLE}}}}}\n"

    async with open_field(tmp_path, sitl, change=with_key, before=switched_on) as field:
        assert await field.ended(150.0) == 0, field.said()
        assert field.report()["receivers"][0]["placement_error_m"] < 1.0
        for name, wire in field.wires.items():
            print(f"{name}: service {dict(wire.signed[True])}, vehicle {dict(wire.signed[False])} (signed: frames)")
            assert wire.signed[True][True] > 50
            assert wire.signed[True][False] == wire.signed[False][False] == 0

        status, said = await asyncio.to_thread(check, field, signed=False)
        print(said)
        assert status == 1, "a station without the key was obeyed"

        async with open_signing(SystemClock(), tmp_path / "other") as signing:
            for name, wire in field.wires.items():
                setup(wire, bytes(32), Codec(signing=signing.link(SigningKey(KEY), name)))
            await asyncio.sleep(1.0)
        status, said = await asyncio.to_thread(check, field, signed=False)
        assert status == 0, said
