"""Faults in mid-leg, with real processes: zero velocity on the wire within a second, a message, a clean end.

The same field without a fault forms and lands: `test_wind` and `test_operator_flight` fly it to its end.
"""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.gcs.field import open_field

pytestmark = pytest.mark.slow

ZERO = pytest.approx(0.0, abs=1e-6)


async def test_killing_the_bus_mid_leg(tmp_path: Path) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        await field.until_moving()
        field.signal("router", signal.SIGKILL)
        killed_s = time.monotonic()
        await field.until_waiting("resume")
        field.service.send_signal(signal.SIGINT)  # nobody's word gets through to a run without a bus
        assert await field.ended() == 1
        assert field.wire.velocities[-1][0] > killed_s
        assert field.fastest_after(killed_s + 1.0) == ZERO
        assert "the bus router cannot be reached" in field.said()
        assert field.report()["receivers"][0]["state"] == "HELD"


async def test_silencing_the_sensor_mid_leg(tmp_path: Path) -> None:
    async with open_field(tmp_path, options=("--attended",)) as field:
        await field.until_moving()
        await field.silence("U1")
        silenced_s = time.monotonic()
        await field.until_waiting("resume")
        assert (await field.say("abort")).ok
        assert await field.ended() == 1
        assert field.wire.velocities[-1][0] > silenced_s
        assert field.fastest_after(silenced_s + 1.0) == ZERO
        assert "no bearing report from its sensor" in field.said()
        status, said = await field.control("hold")
        assert status == 2
        assert "is not answered" in said


async def test_freezing_the_copter_mid_leg(tmp_path: Path) -> None:
    async with open_field(tmp_path) as field:
        await field.until_moving()
        field.signal("U1", signal.SIGSTOP)
        frozen_s = time.monotonic()
        assert await field.ended() == 1
        assert field.wire.velocities[-1][0] > frozen_s
        assert field.fastest_after(frozen_s + 1.0) == ZERO
        assert "no telemetry for" in field.said()


async def test_ctrl_c_mid_leg(tmp_path: Path) -> None:
    async with open_field(tmp_path) as field:
        await field.until_moving()
        field.service.send_signal(signal.SIGINT)
        interrupted_s = time.monotonic()
        assert await field.ended() == 1
        assert field.wire.velocities[-1][0] > interrupted_s - 0.2
        assert field.wire.velocities[-1][1] == ZERO
        assert field.fastest_after(interrupted_s + 0.5) == ZERO
        assert "stopped by the operator" in field.said()
        assert field.report()["outcome"] == "aborted"


async def test_a_copter_that_never_answers_and_one_that_falls_silent_before_it_is_armed(tmp_path: Path) -> None:
    async with open_field(tmp_path, absent=["L1"]) as field:
        await field.until(lambda: field.wires["L0"].signed[True].total() > 0, 30.0)
        field.signal("L0", signal.SIGKILL)
        assert await field.ended(60.0) == 1
        assert "it fell silent: nothing was heard of it for 10 s" in field.said()
        assert "L1 on udpin:127.0.0.1:" in field.said()
        assert "no heartbeat of system id 2 within 30 s" in field.said()
        assert field.report()["outcome"] == "failed"
        assert not field.wire.velocities
        assert not field.wire.was_armed
