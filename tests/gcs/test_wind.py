"""Simulated wind is felt by whoever hovers in it, and the relay forms all the same."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import SimulationError
from drivers.simulation.sitl import SITLS, Sitl
from drivers.simulation.weather import SimulatedWeather
from tests.gcs.field import open_field

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(
    params=[None, pytest.param("ardupilot", marks=pytest.mark.sitl_ardupilot)],
    ids=["embedded", "ardupilot"],
)
def sitl(request: pytest.FixtureRequest) -> Sitl | None:
    if request.param is None:
        return None
    try:
        SITLS[request.param].find()
    except SimulationError as error:
        pytest.skip(str(error))
    return SITLS[request.param]


async def test_who_hovers_leans_into_the_wind_and_the_relay_forms_and_lands(sitl: Sitl | None, tmp_path: Path) -> None:
    from_north = SimulatedWeather(wind_mps=8.0, wind_from_rad=0.0)
    async with open_field(tmp_path, sitl, weather=from_north) as field:
        await field.until(lambda: "U1 LEG_1" in field.said(), 90.0)
        hovering = field.wires["L0"]  # its nose to the north
        hovering.command(mavlink.MAVLINK_MSG_ID_ATTITUDE, 1e5, number=mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
        await field.until(lambda: len(hovering.attitudes) > 50, 20.0)
        roll_deg, pitch_deg = (math.degrees(statistics.mean(angle)) for angle in zip(*hovering.attitudes, strict=True))
        print(f"mean roll {roll_deg:.1f}, pitch {pitch_deg:.1f} degrees")
        assert pitch_deg < -8.0
        assert abs(roll_deg) < 5.0
        assert await field.ended(120.0) == 0, field.lines
        assert field.report()["outcome"] == "formed"
        assert field.wire.was_armed
        assert field.wire.armed is False
        error_m = field.report()["receivers"][0]["placement_error_m"]
        print(f"placement error {error_m:.2f} m")
        assert error_m < 1.0
