"""A pilot takes a copter in mid-leg and gives it back: the real commands over the real bus and wire."""

from __future__ import annotations

import asyncio
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.gcs.field import Field, open_field

pytestmark = pytest.mark.slow

GUIDED, LOITER = 4, 5


async def typed(field: Field, *words: str) -> tuple[int, str]:
    """Type a control command; return its exit status and what it says."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gcs.cli", "control", *words, "--runs-dir", str(field.runs_dir)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    said, _ = await process.communicate()
    assert process.returncode is not None
    return process.returncode, said.decode()


async def taken_over(field: Field) -> float:
    """Let the pilot take the copter in mid-leg; return when the service had heard of it."""
    await field.until_moving()
    field.wire.command(1.0, LOITER)
    await field.until(lambda: field.wire.modes[-1][1] == LOITER, 5.0)
    heard_s = field.wire.modes[-1][0]
    await field.until(lambda: "waiting for the operator: bearing-relay control release U1" in field.said(), 5.0)
    return heard_s


async def test_a_pilot_s_copter_gets_no_setpoint_until_it_is_released_and_resumed_it_reaches_its_slot(
    tmp_path: Path,
) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        heard_s = await taken_over(field)
        status, said = await typed(field, "release", "U1")
        assert status == 1
        assert "GUIDED" in said
        status, said = await typed(field, "resume")
        assert status == 1
        assert "release U1" in said
        field.wire.command(1.0, GUIDED)
        await field.until(lambda: field.wire.modes[-1][1] == GUIDED, 5.0)
        assert (await typed(field, "release", "U1"))[0] == 0
        await asyncio.sleep(1.0)
        assert max(field.wire.setpoints) <= heard_s + 0.05  # not one since, guided mode and release or not
        resumed_s = time.monotonic()
        assert (await typed(field, "resume"))[0] == 0
        assert await field.ended(90.0) == 0, field.lines
        assert min(at for at in field.wire.setpoints if at > heard_s + 0.05) > resumed_s
        assert field.report()["receivers"][0]["placement_error_m"] < 1.0


async def test_ctrl_c_ends_a_run_that_waits_for_the_operator(tmp_path: Path) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        await taken_over(field)
        await asyncio.sleep(2.0)
        assert field.service.returncode is None
        field.service.send_signal(signal.SIGINT)
        assert await field.ended() == 1
        assert field.report()["receivers"][0]["state"] == "PILOT"


async def test_abort_ends_it_too_and_afterwards_nobody_answers(tmp_path: Path) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        await taken_over(field)
        assert (await typed(field, "abort"))[0] == 0
        assert await field.ended() == 1
        status, said = await typed(field, "hold")
        assert status == 2
        assert "is not answered" in said
