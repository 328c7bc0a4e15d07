"""ArduCopter: GUIDED, NAV_TAKEOFF, BRAKE, LAND, RTL, as measured on 4.6.

In silence it hovers in GUIDED after GUID_TIMEOUT: it needs no stream while nobody moves it. It shapes velocity itself.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.ardupilot_parameters import (
    PARAMETER_CHECKS,
    RETURN_PARAMETERS,
    failsafe_return_altitude_m,
)
from drivers.mavlink.autopilots.base import MULTICOPTERS, ParameterKnowledge, StreamNeeds
from drivers.mavlink.parameters import cast_value
from drivers.mavlink.vehicle import Heartbeat, Vehicle

MODE_GUIDED: Final = 4
MODE_RTL: Final = 6
MODE_LAND: Final = 9
MODE_BRAKE: Final = 17

READY_TIMEOUT_S: Final = 90.0
"""The estimator of a copter switched on just now needs 42 s."""
MODE_TIMEOUT_S: Final = 5.0
ARM_TIMEOUT_S: Final = 5.0
CLIMB_TIMEOUT_S: Final = 20.0
CLIMB_S_PER_M: Final = 2.0
LAND_TIMEOUT_S: Final = 120.0
RETURN_TIMEOUT_S: Final = 600.0
_REACHED: Final = 0.95

_ESTIMATOR_POSITION_ABSOLUTE: Final = mavlink.EKF_POS_HORIZ_ABS

_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}


class ArduCopter:
    """ArduPilot on a multicopter."""

    name = "ArduPilot"
    vehicle_types = MULTICOPTERS
    stream = StreamNeeds()
    parameters = ParameterKnowledge(cast_value, PARAMETER_CHECKS, RETURN_PARAMETERS, failsafe_return_altitude_m)
    complaint = "PreArm: "

    def is_guided(self, heartbeat: Heartbeat) -> bool:
        """Return whether the mode is GUIDED."""
        return heartbeat.custom_mode == MODE_GUIDED

    async def prepare(self, vehicle: Vehicle) -> None:
        """Request position, estimator status and health, and wait for an absolute position estimate."""
        vehicle.rates.ask(_RATES_HZ)
        await vehicle.wait_until(
            lambda: (
                bool(vehicle.telemetry.estimator_flags & _ESTIMATOR_POSITION_ABSOLUTE)
                and vehicle.telemetry.kinematics is not None
            ),
            READY_TIMEOUT_S,
            "position estimate",
            "Check GPS reception and the EKF messages.",
        )

    async def arm(self, vehicle: Vehicle) -> None:
        """Enter GUIDED and arm."""
        await self._enter(vehicle, MODE_GUIDED, "GUIDED")
        await self._arm(vehicle)

    async def take_off(self, vehicle: Vehicle, altitude_m: float) -> None:
        """Enter GUIDED, arm, NAV_TAKEOFF; return at the altitude. No setpoint may run before: it cancels the climb."""
        await self._enter(vehicle, MODE_GUIDED, "GUIDED")
        if vehicle.armed and _height_m(vehicle) >= _REACHED * altitude_m:
            return
        if not vehicle.armed:
            await self._arm(vehicle)
        await vehicle.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, altitude_m, what="take-off")
        await vehicle.wait_until(
            lambda: _height_m(vehicle) >= _REACHED * altitude_m,
            CLIMB_TIMEOUT_S + CLIMB_S_PER_M * altitude_m,
            f"climb to {altitude_m:g} m",
            "Watch the vehicle: it may be on its way up.",
        )

    def hold(self, vehicle: Vehicle) -> None:
        """Ask for BRAKE."""
        _ask(vehicle, MODE_BRAKE)

    async def land(self, vehicle: Vehicle) -> None:
        """Ask for LAND and wait until the copter has disarmed itself."""
        _ask(vehicle, MODE_LAND)
        await vehicle.wait_until(lambda: not vehicle.armed, LAND_TIMEOUT_S, "touch-down", "Land it by hand.")

    async def return_home(self, vehicle: Vehicle) -> None:
        """Ask for RTL, which lands at home, and wait until the copter has disarmed itself."""
        _ask(vehicle, MODE_RTL)
        await vehicle.wait_until(lambda: not vehicle.armed, RETURN_TIMEOUT_S, "touch-down at home", "Land it by hand.")

    async def _arm(self, vehicle: Vehicle) -> None:
        await vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, what="arming")
        await vehicle.wait_until(
            lambda: vehicle.armed, ARM_TIMEOUT_S, "armed heartbeat", "See the autopilot's messages."
        )

    async def _enter(self, vehicle: Vehicle, mode: int, name: str) -> None:
        """Ask for a mode and believe only the heartbeat: an acknowledged change may not have happened."""
        vehicle.tell(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)
        await vehicle.wait_until(
            lambda: vehicle.custom_mode == mode, MODE_TIMEOUT_S, f"heartbeat in {name}", "Another station or RC switch?"
        )


def _height_m(vehicle: Vehicle) -> float:
    return vehicle.telemetry.relative_altitude_m or 0.0


def _ask(vehicle: Vehicle, mode: int) -> None:
    vehicle.tell_urgently(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)
