"""Two link nodes as processes, and one of them killed in the middle of a leg."""

from __future__ import annotations

import asyncio
import signal
import time
from pathlib import Path

import pytest

from gcs.nodes.serving import GRANT_S
from gcs.nodes.tenure import YIELD_S
from tests.gcs.nodes.two_sites import open_sites

GUIDED_TIMEOUT_S = 3.0
"""After so long without a setpoint an ArduCopter stops by itself (GUID_TIMEOUT)."""
NOISE_S = 1.0
"""What a busy machine may add to anything."""
RUNNING_OUT_S = 3.0
"""A copter at 4 m/s has stopped within this, on a noisy machine."""


@pytest.mark.slow
@pytest.mark.timeout(200)
async def test_a_node_killed_in_mid_leg_is_replaced_with_the_operator_s_consent(tmp_path: Path) -> None:
    async with open_sites(tmp_path) as sites:
        tap = sites.taps["U1"]
        await sites.until(lambda: bool(tap.speeds) and tap.speeds[-1] > 2.0, 90.0, "leg of U1")
        sites.group.processes["north"].send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        await sites.until(lambda: sites.state("U1") == "HELD", 5.0, "hold")
        assert not (await sites.speak("resume")).ok
        await sites.until(lambda: tap.kinematics[-1][1] < 0.3, 20.0, "stop of U1")
        assert tap.kinematics[-1][0] - killed_s < GUIDED_TIMEOUT_S + RUNNING_OUT_S
        assert max(tap.setpoints) < killed_s + 0.5  # nobody speaks for it before the operator does
        consented_s = time.monotonic()
        await sites.until_done("takeover", "north", 10.0)
        await sites.until(lambda: "south has taken over" in sites.said(), 30.0, "take-over")
        assert not [at for at in tap.setpoints if killed_s + 0.5 < at < consented_s]
        await sites.until_done("resume", None, 10.0)
        await sites.until(lambda: sites.state("U1") == sites.state("U2") == "PLACED", 90.0, "formation")
        await sites.service.wait()
        assert sites.service.returncode == 0, sites.said()


@pytest.mark.slow
@pytest.mark.timeout(240)
async def test_without_their_service_nodes_stop_their_vehicles_and_the_next_service_goes_on(tmp_path: Path) -> None:
    async with open_sites(tmp_path) as sites:
        tap = sites.taps["U1"]
        await sites.until(lambda: bool(tap.speeds) and tap.speeds[-1] > 2.0, 90.0, "leg of U1")
        await sites.kill()
        killed_s = time.monotonic()
        await asyncio.sleep(GRANT_S + YIELD_S + NOISE_S)
        flown = [at for at, speed in zip(tap.setpoints, tap.speeds, strict=True) if speed > 0.0]
        assert max(flown) < killed_s + GRANT_S + NOISE_S
        assert tap.speeds[-1] == 0.0  # it was told to stop, not only left alone
        assert max(tap.setpoints) < killed_s + GRANT_S + YIELD_S + NOISE_S
        await sites.start("resume", str(next((tmp_path / "runs").iterdir())), "--attended")
        await sites.until(lambda: sites.state("U1") == sites.state("U2") == "PLACED", 120.0, "formation")
        await sites.service.wait()
        assert sites.service.returncode == 0, sites.said()
