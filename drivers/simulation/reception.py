"""What an ArduCopter does with each message it receives."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation import setpoints
from drivers.simulation.commands import Result, carry_out, change_mode, read_command
from drivers.simulation.parameters import TABLE
from drivers.simulation.port import Port
from drivers.simulation.telemetry import Message
from drivers.simulation.vehicle import Vehicle

Handler = Callable[[Vehicle, Port, Message], None]


def heartbeat(vehicle: Vehicle, _port: Port, message: Message) -> None:
    """Note that a station lives."""
    vehicle.failsafe.hear(message.get_srcSystem())


def command(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Carry out a command, then acknowledge it."""
    result = carry_out(vehicle, port, read_command(message))
    _acknowledge(port, message, message.command, result)


def set_mode(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Change the mode; acknowledged like a command that has this message's number."""
    custom = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    result = change_mode(vehicle.flight, port, message.custom_mode) if custom else Result.DENIED
    _acknowledge(port, message, mavlink.MAVLINK_MSG_ID_SET_MODE, result)


def set_position_target_local_ned(vehicle: Vehicle, _port: Port, message: Message) -> None:
    """Obey a setpoint in local axes."""
    vehicle.flight.obey(setpoints.read_local(vehicle, message))


def set_position_target_global_int(vehicle: Vehicle, _port: Port, message: Message) -> None:
    """Obey a setpoint in degrees."""
    vehicle.flight.obey(setpoints.read_global(vehicle, message))


def request_data_stream(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Set the rate of a group of reports."""
    rate_hz = message.req_message_rate if message.start_stop else 0
    port.streams.set_group(message.req_stream_id, 1.0 / rate_hz if rate_hz else inf, vehicle.flight.time_s)


def param_request_list(vehicle: Vehicle, port: Port, _message: Message) -> None:
    """Send every parameter."""
    for parameter in TABLE:
        _send_parameter(vehicle, port, parameter.name)


def param_request_read(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Send one parameter, asked for by name (index -1) or by index."""
    if 0 <= message.param_index < len(TABLE):
        _send_parameter(vehicle, port, TABLE[message.param_index].name)
    elif message.param_index == -1 and message.param_id in vehicle.flight.parameters:
        _send_parameter(vehicle, port, message.param_id)


def param_set(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Change a parameter and send its new value; an unknown one gets no answer."""
    if vehicle.flight.parameters.set(message.param_id, message.param_value):
        _send_parameter(vehicle, port, message.param_id)


def mission_request_list(_vehicle: Vehicle, port: Port, message: Message) -> None:
    """Answer that there is no mission."""
    station = message.get_srcSystem(), message.get_srcComponent()
    port.send(mavlink.MAVLink_mission_count_message(*station, 0, message.mission_type))


def mission_count(_vehicle: Vehicle, port: Port, message: Message) -> None:
    """Refuse the upload of a mission."""
    station = message.get_srcSystem(), message.get_srcComponent()
    port.send(mavlink.MAVLink_mission_ack_message(*station, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type))


def timesync(vehicle: Vehicle, port: Port, message: Message) -> None:
    """Answer a request (tc1 = 0) with the time since switch-on, ns."""
    if message.tc1 == 0:
        port.send(mavlink.MAVLink_timesync_message(round(vehicle.flight.time_s * 1e9), message.ts1))


def _acknowledge(port: Port, message: Message, number: int, result: Result) -> None:
    station = message.get_srcSystem(), message.get_srcComponent()
    port.send(mavlink.MAVLink_command_ack_message(number, result, 0, 0, *station))


def _send_parameter(vehicle: Vehicle, port: Port, name: str) -> None:
    parameters = vehicle.flight.parameters
    index = parameters.index_of(name)
    port.send(
        mavlink.MAVLink_param_value_message(name.encode(), parameters[name], TABLE[index].kind, len(TABLE), index)
    )


HANDLERS: dict[int, Handler] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: command,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: command,
    mavlink.MAVLINK_MSG_ID_SET_MODE: set_mode,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: set_position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: set_position_target_global_int,
    mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: request_data_stream,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: param_request_list,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: param_request_read,
    mavlink.MAVLINK_MSG_ID_PARAM_SET: param_set,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: mission_request_list,
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: mission_count,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: timesync,
}
