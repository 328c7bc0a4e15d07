"""The air that simulated vehicles fly in, as each simulator is told of it."""

import math

import pytest

from drivers.errors import SimulationError
from drivers.simulation.parameters import Parameters
from drivers.simulation.weather import (
    CALM,
    SimulatedWeather,
    arducopter_parameters,
    copter_parameters,
    px4_parameters,
)

WINDY = SimulatedWeather(wind_mps=6.0, wind_from_rad=math.radians(120.0), gusts_mps=1.5)


def test_an_embedded_copter_takes_every_parameter_it_is_told():
    told = copter_parameters(WINDY)
    parameters = Parameters()
    assert all(parameters.set(name, value) for name, value in told.items())
    assert parameters["SIM_WIND_SPD"] == 6.0
    assert parameters["SIM_WIND_DIR"] == pytest.approx(120.0)
    assert parameters["SIM_WIND_TURB"] == 1.5


def test_an_embedded_copter_s_exact_position_is_no_silent_substitute_for_a_noisy_one():
    with pytest.raises(SimulationError, match=r"leave out simulation.gps_noise_m, or fly --sitl ardupilot"):
        copter_parameters(SimulatedWeather(gps_noise_m=0.5))


def test_arducopter_s_wind_is_in_full_at_every_altitude_that_is_flown():
    told = arducopter_parameters(WINDY)
    assert told["SIM_WIND_T_ALT"] == 2.0
    assert told["SIM_WIND_SPD"] == 6.0
    assert told["SIM_WIND_DIR"] == pytest.approx(120.0)


def test_arducopter_s_gps_strays_by_its_velocity_under_the_names_of_both_versions():
    told = arducopter_parameters(SimulatedWeather(gps_noise_m=0.2))
    assert told["SIM_GPS_VERR_X"] == told["SIM_GPS1_VERR_Y"] == pytest.approx(1.0)
    assert told["SIM_GPS_ACC"] == 0.3
    assert told["SIM_WIND_SPD"] == 0.0


def test_in_a_calm_the_autopilots_simulators_are_told_nothing(tmp_path):
    assert arducopter_parameters(CALM) == {}
    assert px4_parameters(CALM, tmp_path / "no program is read for that") == {}


@pytest.mark.parametrize(
    ("from_deg", "north_mps", "east_mps"), [(0.0, 6.0, 0.0), (90.0, 0.0, 6.0), (225.0, -4.243, -4.243)]
)
def test_px4_s_wind_is_where_it_comes_from(tmp_path, from_deg, north_mps, east_mps):
    program = tmp_path / "px4"
    program.write_bytes(b"\x7fELF...SIH_WIND_N\0SIH_WIND_E\0")
    told = px4_parameters(SimulatedWeather(6.0, math.radians(from_deg)), program)
    assert told == {
        "SIH_WIND_N": pytest.approx(north_mps, abs=1e-3),
        "SIH_WIND_E": pytest.approx(east_mps, abs=1e-3),
    }


@pytest.mark.parametrize(
    ("weather", "complaint"),
    [
        (SimulatedWeather(wind_mps=3.0), "has no wind, as in PX4 1.17: leave out simulation.wind_mps"),
        (SimulatedWeather(gusts_mps=1.0), "has no gusts"),
        (SimulatedWeather(gps_noise_m=1.0), "noise of its own on GPS positions"),
    ],
)
def test_weather_that_a_px4_cannot_simulate_is_refused(tmp_path, weather, complaint):
    program = tmp_path / "px4"
    program.write_bytes(b"\x7fELF...SIH_KDV\0")
    with pytest.raises(SimulationError, match=complaint):
        px4_parameters(weather, program)
