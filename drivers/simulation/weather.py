"""The air that simulated vehicles fly in, and how each simulator is told of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.errors import SimulationError

_GPS_VELOCITY_PER_POSITION: Final = 5.0
"""1/s; ArduPilot's simulated GPS errs in velocity only: the estimate then strays by a fifth of that, up to 0.5 m."""
_GPS_ACCURACY_M: Final = 0.3
_WIND_FROM_M: Final = 2.0
"""From here up it blows in full, by default from 60 m; below it less: with wind on the ground no landing is noticed."""


@dataclass(frozen=True)
class SimulatedWeather:
    """Wind and gusts (standard deviation), m/s; where the wind comes from; how far a GPS position strays, m."""

    wind_mps: float = 0.0
    wind_from_rad: float = 0.0
    """Azimuth, true north = 0, clockwise."""
    gusts_mps: float = 0.0
    gps_noise_m: float = 0.0


CALM: Final = SimulatedWeather()


def copter_parameters(weather: SimulatedWeather) -> dict[str, float]:
    """Return the parameters of an embedded copter. SimulationError for noise that its positions cannot have."""
    if weather.gps_noise_m:
        raise SimulationError(
            "embedded copters know where they are exactly: leave out simulation.gps_noise_m, or fly --sitl ardupilot"
        )
    return _wind(weather)


def arducopter_parameters(weather: SimulatedWeather) -> dict[str, float]:
    """Return the parameters of ArduCopter's simulator, by the names of 4.6 and of 4.7 where they differ."""
    if weather == CALM:
        return {}
    told = {**_wind(weather), "SIM_WIND_T_ALT": _WIND_FROM_M}
    if weather.gps_noise_m:
        velocity_mps = _GPS_VELOCITY_PER_POSITION * weather.gps_noise_m
        for gps in ("SIM_GPS", "SIM_GPS1"):
            told |= {f"{gps}_VERR_X": velocity_mps, f"{gps}_VERR_Y": velocity_mps}
            told[f"{gps}_ACC"] = max(_GPS_ACCURACY_M, weather.gps_noise_m)
    return told


def px4_parameters(weather: SimulatedWeather, program: Path) -> dict[str, float]:
    """Return the parameters of PX4's simulator. SimulationError for weather that this program cannot simulate."""
    if weather.gusts_mps or weather.gps_noise_m:
        raise SimulationError(
            "PX4's simulator has no gusts, and noise of its own on GPS positions (0.2 m): "
            "leave out simulation.gusts_mps and simulation.gps_noise_m, or fly --sitl ardupilot"
        )
    if not weather.wind_mps:
        return {}
    if b"SIH_WIND_N" not in program.read_bytes():
        raise SimulationError(
            f"the simulator in {program} has no wind, as in PX4 1.17: "
            "leave out simulation.wind_mps, fly --sitl ardupilot, or build a newer PX4"
        )
    return {
        "SIH_WIND_N": weather.wind_mps * math.cos(weather.wind_from_rad),
        "SIH_WIND_E": weather.wind_mps * math.sin(weather.wind_from_rad),
    }


def _wind(weather: SimulatedWeather) -> dict[str, float]:
    return {
        "SIM_WIND_SPD": weather.wind_mps,
        "SIM_WIND_DIR": math.degrees(weather.wind_from_rad),
        "SIM_WIND_TURB": weather.gusts_mps,
    }
