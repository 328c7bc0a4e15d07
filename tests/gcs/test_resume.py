"""A service killed in mid-leg over copters that outlive it, and `resume`: with real processes."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec, FrameSplitter
from gcs.recording.journal_reading import Change, read_journal
from gcs.relay.states import ReceiverState
from tests.gcs.field import Field, open_field

pytestmark = pytest.mark.slow

NEVER_AGAIN = {mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF}
GUIDED = 4


async def resume(field: Field, *options: str) -> tuple[int, str]:
    """Run the command to its end; its exit status and all it said."""
    (run,) = field.runs_dir.iterdir()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gcs.cli", "resume", str(run), *options),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    output, _ = await asyncio.wait_for(process.communicate(), 120.0)
    assert process.returncode is not None
    return process.returncode, " ".join(output.decode().split())


async def kill(field: Field) -> None:
    field.service.send_signal(signal.SIGKILL)
    await field.service.wait()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(20.0):
        while not condition():  # noqa: ASYNC110 - other processes have no event to wait for
            await asyncio.sleep(0.02)


def commands_after(folder: Path) -> set[int]:
    """The commands that were sent to any vehicle by a service that went on, from its tlogs."""
    sent: set[int] = set()
    for path in folder.glob("tlogs/*-2.tlog"):
        splitter, codec, data = FrameSplitter(), Codec(), path.read_bytes()
        assert data
        while data:
            length = 8 + 12 + data[9] + (13 if data[10] & 1 else 0)
            for frame in splitter.datagram(data[8:length]):
                message = codec.decode(frame)
                if message is not None and message.get_type() == "COMMAND_LONG":
                    sent.add(message.command)
            data = data[length:]
    return sent


async def test_a_service_killed_in_mid_leg_is_resumed_and_forms(tmp_path: Path) -> None:
    async with open_field(tmp_path) as field:
        await field.until(lambda: len(field.wire.velocities) > 25, 60.0)  # some seconds into its leg
        (run,) = field.runs_dir.iterdir()
        await kill(field)
        before = (run / "journal.jsonl").read_bytes()
        status, said = await resume(field)
        assert status == 0, said
        assert (run / "journal.jsonl").read_bytes().startswith(before)
        journal = read_journal(run / "journal.jsonl")
        states = [entry.state for entry in journal.entries if isinstance(entry, Change)]
        assert journal.lost == ()
        assert ReceiverState.HELD in states
        assert states[-1] is ReceiverState.PLACED
        report = json.loads((run / "report.json").read_text())
        assert report["outcome"] == "formed"
        (receiver,) = report["receivers"]
        assert receiver["placement_error_m"] < 1.0
        assert report["flown_total_length_m"] > sum(leg["flown_length_m"] for leg in receiver["legs"]) + 2.0
        assert (run / "flight.mcap").exists()
        assert (run / "flight-2.mcap").exists()
        assert commands_after(run)
        assert not commands_after(run) & NEVER_AGAIN
        assert field.wire.armed is False, "it landed after the relay"


async def test_who_is_on_the_ground_is_neither_armed_nor_taken_off(tmp_path: Path) -> None:
    async with open_field(tmp_path) as field:
        await field.until(lambda: field.wire.armed is True, 60.0)
        await kill(field)
        for wire in field.wires.values():
            wire.command(0.0, 21196.0, number=mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
        await until(lambda: all(wire.armed is False for wire in field.wires.values()))
        status, said = await resume(field)
        assert status == 2, said
        assert "on the ground" in said
        assert all(wire.armed is False for wire in field.wires.values())
