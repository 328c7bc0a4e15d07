"""PX4 on a multicopter: OFFBOARD with its setpoint stream before and during, LOITER, LAND, RTL, as measured on 1.17.

OFFBOARD ends a second after the stream does, and comes back by itself within 0.1 s of a stream that returns. Between
legs the service therefore keeps streaming the place to hold, instead of leaving OFFBOARD for LOITER: any other mode is
then somebody else's word, the pilot's own LOITER too, and no leg begins by taking the vehicle back. If the service
dies, COM_OBL_RC_ACT 5 holds the vehicle; if its stream had a gap, it is never resumed unasked.

Velocities go out with the mask that ArduPilot gets, their altitude held by the streamer's own loop: the mixed mask with
a position z holds it as well, but z counts from an origin of the vehicle's own.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.autopilots.base import MULTICOPTERS, ParameterKnowledge, StreamNeeds
from drivers.mavlink.autopilots.px4_parameters import PARAMETER_CHECKS, RETURN_PARAMETERS, failsafe_return_altitude_m
from drivers.mavlink.codec import Message
from drivers.mavlink.link import Setpoint
from drivers.mavlink.parameters import bytewise_value
from drivers.mavlink.setpoint_messages import position_setpoint, velocity_setpoint
from drivers.mavlink.vehicle import Heartbeat, Vehicle
from planner.frames import GeodeticPosition

MODE_OFFBOARD: Final = 0x0006_0000
MODE_LOITER: Final = 0x0304_0000
MODE_RTL: Final = 0x0504_0000
MODE_LAND: Final = 0x0604_0000

READY_TIMEOUT_S: Final = 60.0
MODE_TIMEOUT_S: Final = 5.0
ARM_TIMEOUT_S: Final = 5.0
LAND_TIMEOUT_S: Final = 120.0
RETURN_TIMEOUT_S: Final = 600.0

STREAM_PERIOD_S: Final = 0.1
STREAM_BEFORE_S: Final = 1.0
"""How long setpoints flow before OFFBOARD is asked for."""
LONGEST_GAP_S: Final = 0.8
"""COM_OF_LOSS_T is 1 s, less what delivery may take."""
ACCELERATION_MPS2: Final = 2.5
"""ArduCopter's WPNAV_ACCEL: both kinds of vehicle follow a leg alike."""
CLIMB_MPS: Final = 1.5
CLIMB_MPS2: Final = 1.0
CLIMB_TIMEOUT_S: Final = 20.0
CLIMB_S_PER_M: Final = 2.0
_REACHED: Final = 0.95

_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
}


def hold_here(vehicle: Vehicle, altitude_m: float) -> Message:
    """Return the position setpoint of where the vehicle is now, `altitude_m` above home.

    A place it told too long ago is none to go back to: zero velocity then.
    """
    kinematics = vehicle.telemetry.kinematics
    if kinematics is None or vehicle.clock.now_s() - kinematics.time_s > LONGEST_GAP_S:
        return velocity_setpoint(vehicle.system_id, 0j, 0.0)
    return position_setpoint(vehicle.system_id, _above_home(vehicle, altitude_m))


class Px4Copter:
    """PX4 on a multicopter."""

    name = "PX4"
    vehicle_types = MULTICOPTERS
    stream = StreamNeeds(hold_here, LONGEST_GAP_S, ACCELERATION_MPS2)
    parameters = ParameterKnowledge(bytewise_value, PARAMETER_CHECKS, RETURN_PARAMETERS, failsafe_return_altitude_m)
    complaint = "Preflight"

    def is_guided(self, heartbeat: Heartbeat) -> bool:
        """Return whether the mode is OFFBOARD."""
        return heartbeat.custom_mode == MODE_OFFBOARD

    async def prepare(self, vehicle: Vehicle) -> None:
        """Request mode, position and health, and wait until PX4 calls itself armable."""
        vehicle.rates.ask(_RATES_HZ)
        await vehicle.wait_until(
            lambda: _armable(vehicle) and vehicle.telemetry.kinematics is not None,
            READY_TIMEOUT_S,
            "readiness to arm",
            "Clear what the pre-arm checks complain about.",
        )

    async def arm(self, vehicle: Vehicle) -> None:
        """Arm, in whatever mode allows it: OFFBOARD would need a stream already."""
        await vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, what="arming")
        await vehicle.wait_until(
            lambda: vehicle.armed, ARM_TIMEOUT_S, "armed heartbeat", "See the autopilot's messages."
        )

    async def take_off(self, vehicle: Vehicle, altitude_m: float) -> None:
        """Stream, enter OFFBOARD, arm, and let the streamed altitude rise; return at the altitude, still streaming.

        Given up halfway, it holds in LOITER; taken over by a pilot, not one more setpoint leaves.
        """
        climb = _Climb(vehicle, altitude_m)
        vehicle.on_heartbeat.append(climb.watch)
        streaming = asyncio.ensure_future(climb.run())
        arrived = False
        try:
            await vehicle.clock.sleep(STREAM_BEFORE_S)
            vehicle.tell(mavlink.MAV_CMD_DO_SET_MODE, *_mode_parameters(MODE_OFFBOARD))
            await vehicle.wait_until(
                lambda: climb.offboard, MODE_TIMEOUT_S, "heartbeat in OFFBOARD", "Another station or RC switch?"
            )
            if not vehicle.armed:
                await self.arm(vehicle)
            climb.rising = True
            await vehicle.wait_until(
                lambda: climb.taken_over or (vehicle.telemetry.relative_altitude_m or 0.0) >= _REACHED * altitude_m,
                CLIMB_TIMEOUT_S + CLIMB_S_PER_M * altitude_m,
                f"climb to {altitude_m:g} m",
                "It holds where it is.",
            )
            if climb.taken_over:
                raise vehicle.failure("left OFFBOARD during its take-off", "A pilot, a station or a failsafe has it.")
            arrived = True
        finally:
            streaming.cancel()
            vehicle.on_heartbeat.remove(climb.watch)
            if not arrived and vehicle.armed and climb.offboard and not climb.taken_over:
                self.hold(vehicle)

    def hold(self, vehicle: Vehicle) -> None:
        """Ask for LOITER, which needs no stream."""
        _ask(vehicle, MODE_LOITER)

    async def land(self, vehicle: Vehicle) -> None:
        """Ask for LAND and wait until the copter has disarmed itself."""
        _ask(vehicle, MODE_LAND)
        await vehicle.wait_until(lambda: not vehicle.armed, LAND_TIMEOUT_S, "touch-down", "Land it by hand.")

    async def return_home(self, vehicle: Vehicle) -> None:
        """Ask for RTL, which lands at home, and wait until the copter has disarmed itself."""
        _ask(vehicle, MODE_RTL)
        await vehicle.wait_until(lambda: not vehicle.armed, RETURN_TIMEOUT_S, "touch-down at home", "Land it by hand.")


class _Climb:
    """The setpoint stream of a take-off: the place it began above, at a height that rises slowly once `rising`."""

    def __init__(self, vehicle: Vehicle, altitude_m: float) -> None:
        self.offboard = False
        self.taken_over = False
        self.rising = False
        self._vehicle = vehicle
        self._altitude_m = altitude_m
        self._home = _above_home(vehicle, 0.0)
        self._height_m = vehicle.telemetry.relative_altitude_m or 0.0
        self._speed_mps = 0.0

    def watch(self, heartbeat: Heartbeat) -> None:
        """Notice when OFFBOARD begins, and when it ends for whatever reason: then the stream ends for good."""
        guided = heartbeat.custom_mode == MODE_OFFBOARD
        self.taken_over = self.taken_over or (self.offboard and not guided)
        self.offboard = self.offboard or guided
        if self.taken_over:
            self._vehicle.link.drop_setpoint(self._vehicle.system_id)

    async def run(self) -> None:
        """Stream until cancelled or taken over."""
        clock = self._vehicle.clock
        while not self.taken_over:
            if self.rising:
                self._speed_mps = min(CLIMB_MPS, self._speed_mps + CLIMB_MPS2 * STREAM_PERIOD_S)
                self._height_m = min(self._altitude_m, self._height_m + self._speed_mps * STREAM_PERIOD_S)
            place = replace(self._home, altitude_m=self._home.altitude_m + self._height_m)
            message = position_setpoint(self._vehicle.system_id, place)
            setpoint = Setpoint(message, clock.now_s() + LONGEST_GAP_S, stops=False)
            self._vehicle.link.post_setpoint(self._vehicle.system_id, setpoint)
            await clock.sleep(STREAM_PERIOD_S)


def _armable(vehicle: Vehicle) -> bool:
    heartbeat = vehicle.telemetry.heartbeat
    standby = heartbeat is not None and heartbeat.system_status == mavlink.MAV_STATE_STANDBY
    return standby or bool(vehicle.telemetry.sensors_healthy & mavlink.MAV_SYS_STATUS_PREARM_CHECK)


def _above_home(vehicle: Vehicle, height_m: float) -> GeodeticPosition:
    """Return the place `height_m` above home at which, or under which, the vehicle is."""
    kinematics, own_height_m = vehicle.telemetry.kinematics, vehicle.telemetry.relative_altitude_m
    if kinematics is None or own_height_m is None:
        raise vehicle.failure("has not told its position", "Check the rate of GLOBAL_POSITION_INT.")
    return replace(kinematics.position, altitude_m=kinematics.position.altitude_m - own_height_m + height_m)


def _mode_parameters(mode: int) -> tuple[float, float, float]:
    """Return the parameters of DO_SET_MODE: main mode and sub-mode stand apart."""
    return float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode >> 16 & 0xFF), float(mode >> 24)


def _ask(vehicle: Vehicle, mode: int) -> None:
    vehicle.tell_urgently(mavlink.MAV_CMD_DO_SET_MODE, *_mode_parameters(mode))
