"""The commands an ArduCopter answers here: what each does, and its MAV_RESULT."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation import setpoints
from drivers.simulation.flight import CRITICAL, Flight
from drivers.simulation.modes import AUTO, Mode
from drivers.simulation.port import Port
from drivers.simulation.telemetry import REPORTS, Message
from drivers.simulation.vehicle import Vehicle

HIGHEST_M = 1e5
FORCE = 21196  # the magic number that disarms in the air
FORCE_REBOOT = 20190226  # the one that reboots an armed vehicle


class Result(IntEnum):
    """The MAV_RESULTs given here."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT: number, parameters 1 to 4, and 5 to 7 as deg, deg, m where they are a place."""

    number: int
    parameters: tuple[float, ...]
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT

    def whole(self, index: int) -> int:
        """Return parameter `index` (from 1) as an integer; -1 if it is no number."""
        value = self.parameters[index - 1]
        return int(value) if isfinite(value) else -1


def read_command(message: Message) -> Command:
    """Return the command in a COMMAND_LONG or COMMAND_INT message."""
    first = (message.param1, message.param2, message.param3, message.param4)
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_INT:
        return Command(message.command, (*first, message.x / 1e7, message.y / 1e7, message.z), message.frame)
    return Command(message.command, (*first, message.param5, message.param6, message.param7))


def carry_out(vehicle: Vehicle, port: Port, command: Command) -> Result:
    """Do what a command says and return its MAV_RESULT."""
    handler = COMMANDS.get(command.number)
    return handler(vehicle, port, command) if handler else Result.UNSUPPORTED


def change_mode(flight: Flight, port: Port, number: int) -> Result:
    """Enter the mode of a number, or say why not."""
    if number == AUTO:
        port.say(CRITICAL, "Mode change to AUTO failed: no mission")
        return Result.FAILED
    if number not in Mode.__members__.values():
        port.say(CRITICAL, f"No such mode {number}")
        return Result.FAILED
    flight.enter(Mode(number))
    return Result.ACCEPTED


def _arm_disarm(vehicle: Vehicle, port: Port, command: Command) -> Result:
    flight, wanted = vehicle.flight, command.whole(1)
    if wanted == 0:
        return Result.ACCEPTED if flight.disarm(forced=command.whole(2) == FORCE) else Result.FAILED
    if wanted != 1:
        return Result.UNSUPPORTED
    was_armed = flight.armed
    refusal = "GCS failsafe on" if vehicle.failsafe.on and not was_armed else flight.arm()
    if refusal:
        port.say(CRITICAL, f"Arm: {refusal}")
        return Result.FAILED
    if not was_armed:
        port.send(REPORTS[mavlink.MAVLINK_MSG_ID_HOME_POSITION](vehicle))
    return Result.ACCEPTED


def _set_mode(vehicle: Vehicle, port: Port, command: Command) -> Result:
    if not command.whole(1) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return Result.DENIED
    return change_mode(vehicle.flight, port, command.whole(2))


def _take_off(vehicle: Vehicle, _port: Port, command: Command) -> Result:
    height_m = command.parameters[6]
    return Result.ACCEPTED if isfinite(height_m) and vehicle.flight.take_off(height_m) else Result.FAILED


def _enter(mode: Mode) -> Handler:
    def handler(vehicle: Vehicle, port: Port, _command: Command) -> Result:
        return change_mode(vehicle.flight, port, mode)

    return handler


def _pause(vehicle: Vehicle, _port: Port, command: Command) -> Result:
    if vehicle.flight.mode is not Mode.GUIDED or command.whole(1) not in (0, 1):
        return Result.FAILED
    vehicle.flight.paused = command.whole(1) == 0
    return Result.ACCEPTED


def _reposition(vehicle: Vehicle, port: Port, command: Command) -> Result:
    flight, (latitude_deg, longitude_deg, height_m) = vehicle.flight, command.parameters[4:]
    if not (abs(latitude_deg) < 90.0 and abs(longitude_deg) <= 180.0 and abs(height_m) < HIGHEST_M):
        return Result.DENIED
    if command.whole(2) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
        change_mode(flight, port, Mode.GUIDED)
    if flight.mode is not Mode.GUIDED:
        return Result.DENIED
    sea_m = vehicle.frame.origin.altitude_m if command.frame in setpoints.ABOVE_SEA_FRAMES else 0.0
    place = (*vehicle.frame.to_metres(latitude_deg, longitude_deg), sea_m - height_m)
    flight.obey(setpoints.go_to(flight, place))
    return Result.ACCEPTED


def _set_interval(vehicle: Vehicle, port: Port, command: Command) -> Result:
    interval_us = command.parameters[1]
    if not isfinite(interval_us):
        return Result.DENIED
    interval_s = inf if interval_us < 0 else interval_us / 1e6 or None
    return (
        Result.ACCEPTED
        if port.streams.set_interval(command.whole(1), interval_s, vehicle.flight.time_s)
        else Result.DENIED
    )


def _get_interval(_vehicle: Vehicle, port: Port, command: Command) -> Result:
    message_id = command.whole(1)
    known, interval_s = message_id in REPORTS, port.streams.interval_s(message_id)
    interval_us = (round(interval_s * 1e6) if interval_s < inf else -1) if known else 0
    port.send(mavlink.MAVLink_message_interval_message(message_id & 0xFFFF, interval_us))
    return Result.ACCEPTED if known else Result.FAILED


def _request_message(vehicle: Vehicle, port: Port, command: Command) -> Result:
    report = REPORTS.get(command.whole(1))
    if report is None:
        return Result.FAILED
    port.send(report(vehicle))
    return Result.ACCEPTED


def _request_version(vehicle: Vehicle, port: Port, _command: Command) -> Result:
    port.send(REPORTS[mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION](vehicle))
    return Result.ACCEPTED


def _get_home(vehicle: Vehicle, port: Port, _command: Command) -> Result:
    port.send(REPORTS[mavlink.MAVLINK_MSG_ID_HOME_POSITION](vehicle))
    return Result.ACCEPTED


def _run_prearm_checks(vehicle: Vehicle, port: Port, _command: Command) -> Result:
    if vehicle.flight.armed:
        return Result.TEMPORARILY_REJECTED
    complaint = vehicle.flight.complaint()
    if complaint:
        port.say(CRITICAL, f"PreArm: {complaint}")
    return Result.ACCEPTED


def _reboot(vehicle: Vehicle, _port: Port, command: Command) -> Result:
    if command.whole(1) != 1:
        return Result.UNSUPPORTED
    if vehicle.flight.armed and command.whole(6) != FORCE_REBOOT:
        return Result.FAILED
    vehicle.reboots = True
    return Result.ACCEPTED


Handler = Callable[[Vehicle, Port, Command], Result]

COMMANDS: dict[int, Handler] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_NAV_LAND: _enter(Mode.LAND),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _enter(Mode.RTL),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: _enter(Mode.LOITER),
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _pause,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_version,
    mavlink.MAV_CMD_GET_HOME_POSITION: _get_home,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _run_prearm_checks,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
}
