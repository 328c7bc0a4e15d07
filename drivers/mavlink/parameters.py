"""Reads parameters of an autopilot by their names.

ArduCopter 4.6 takes 5 to 100 ms for each and queues twenty; PX4 1.17 answers at once; both are silent about a name they
do not know.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Message
from drivers.mavlink.vehicle import Vehicle

PATIENCE_S: Final = 1.0
"""How long after the last answer what is missing is asked for again."""
TRIES: Final = 3
_AT_ONCE: Final = 20
_TYPES: Final = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<B3x",
    mavlink.MAV_PARAM_TYPE_INT8: "<b3x",
    mavlink.MAV_PARAM_TYPE_UINT16: "<H2x",
    mavlink.MAV_PARAM_TYPE_INT16: "<h2x",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}

ParameterValue = Callable[[Message], float]
"""Returns the value in a PARAM_VALUE."""


def cast_value(message: Message) -> float:
    """Return the value where integers are sent as the float nearest to them (ArduPilot)."""
    return float(message.param_value)


def bytewise_value(message: Message) -> float:
    """Return the value where the four bytes of an integer stand in the place of a float (PX4)."""
    layout = _TYPES.get(message.param_type)
    if layout is None:
        return float(message.param_value)
    return float(struct.unpack(layout, struct.pack("<f", message.param_value))[0])


async def read_parameters(vehicle: Vehicle, names: Iterable[str], value_of: ParameterValue) -> dict[str, float]:
    """Return the parameters of these names; one that is not there, or not told in several tries, is left out."""
    wanted = tuple(dict.fromkeys(names))
    found: dict[str, float] = {}

    def take(message: Message) -> None:
        if message.param_id in wanted and math.isfinite(value := value_of(message)):
            found[message.param_id] = value

    with vehicle.hearing(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, take):
        for first in range(0, len(wanted), _AT_ONCE):
            await _read(vehicle, wanted[first : first + _AT_ONCE], found)
    return found


async def _read(vehicle: Vehicle, names: Sequence[str], found: Mapping[str, float]) -> None:
    """Ask for parameters, and again for those not told, until `found` has them or nothing more comes."""

    def missing() -> list[str]:
        return [name for name in names if name not in found]

    async def one_more_comes() -> bool:
        before = len(found)
        return await vehicle.holds_within(PATIENCE_S, lambda: len(found) > before)

    for _ in range(TRIES):
        for name in missing():
            _request(vehicle, name)
        while missing() and await one_more_comes():
            pass


def _request(vehicle: Vehicle, name: str) -> None:
    vehicle.link.post(
        mavlink.MAVLink_param_request_read_message(vehicle.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, name.encode(), -1)
    )
