"""A pilot takes a copter in mid-leg and gives it back: the real commands over the real bus and wire."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from tests.gcs.field import open_field

pytestmark = pytest.mark.slow

GUIDED, LOITER = 4, 5


async def test_a_pilot_s_copter_gets_no_setpoint_until_it_is_released_and_resumed_it_reaches_its_slot(
    tmp_path: Path,
) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        await field.until_moving()
        field.wire.command(1.0, LOITER)
        await field.until(lambda: field.wire.modes[-1][1] == LOITER, 5.0)
        heard_s = next(at for at, mode in field.wire.modes if mode == LOITER)
        await field.until_waiting("release U1")
        status, said = await field.control("release", "U1")
        assert status == 1
        assert "GUIDED" in said
        reply = await field.say("resume")
        assert not reply.ok
        assert "release U1" in reply.message
        field.wire.command(1.0, GUIDED)
        await field.until(lambda: field.wire.modes[-1][1] == GUIDED, 5.0)
        assert (await field.say("release", "U1")).ok
        await asyncio.sleep(1.0)
        resumed_s = time.monotonic()
        assert max(field.wire.setpoints) <= heard_s + 0.05  # not one since, guided mode and release or not
        assert (await field.control("resume"))[0] == 0
        assert await field.ended(90.0) == 0, field.lines
        assert min(at for at in field.wire.setpoints if at > heard_s + 0.05) > resumed_s
        assert field.report()["receivers"][0]["placement_error_m"] < 1.0
