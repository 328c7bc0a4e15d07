"""The fleet: what happens to a vehicle when its stream ends, and what can be asked of --sitl."""

from __future__ import annotations

import asyncio
import contextlib
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.mavlink.autopilots.base import StreamNeeds
from drivers.mavlink.setpoints import StreamState
from gcs.cli import main
from gcs.fleet import Member, stream_for

PAPER_8 = "sitl_configs/paper_8.yaml"
NEEDS_A_STREAM = StreamNeeds(idle_setpoint=lambda _vehicle, _altitude_m: None)


async def held_after(needs: StreamNeeds, state: StreamState) -> list[str]:
    """Run a stream and end it in a state; return the vehicles told to hold."""
    held: list[str] = []
    autopilot: Any = SimpleNamespace(stream=needs, hold=held.append)
    stream: Any = SimpleNamespace(state=state, run=asyncio.Event().wait)
    vehicle: Any = "U1"
    task = asyncio.create_task(stream_for(Member(vehicle, autopilot, stream)))
    await asyncio.sleep(0)
    assert held == []
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    return held


@pytest.mark.parametrize("state", [StreamState.IDLING, StreamState.LEASED, StreamState.STOPPING])
async def test_a_vehicle_that_needs_its_stream_is_left_in_a_hold_that_needs_none(state: StreamState) -> None:
    assert await held_after(NEEDS_A_STREAM, state) == ["U1"]


async def test_one_that_hovers_in_silence_or_is_a_pilot_s_is_left_alone() -> None:
    assert await held_after(StreamNeeds(), StreamState.LEASED) == []
    assert await held_after(NEEDS_A_STREAM, StreamState.PILOT) == []


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    return re.sub(r"\s+", " ", capsys.readouterr().err)


def test_sitl_is_real_time_only(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    said = complaint(capsys, "fly", PAPER_8, "--sitl", "px4", "--speedup", "2", "--runs-dir", str(tmp_path))
    assert "--sitl starts the vehicles itself, in real time" in said


def test_sitl_without_a_program_says_how_to_get_one_and_makes_no_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARDUCOPTER", str(tmp_path / "arducopter"))
    said = complaint(capsys, "fly", PAPER_8, "--sitl", "ardupilot", "--runs-dir", str(tmp_path / "runs"))
    assert "set ARDUCOPTER to the arducopter program" in said
    assert not (tmp_path / "runs").exists()
