"""Which autopilot answers: AUTOPILOT_VERSION.

ArduCopter 4.6.3 in its simulator leaves uid 0 and puts the machine and the instance into uid2; PX4 1.17's has the
instance in both. Together they tell the vehicles of one machine apart. An autopilot that leaves both 0 tells nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Message
from drivers.mavlink.vehicle import Vehicle

PATIENCE_S: Final = 1.0
TRIES: Final = 3
_OTHERS_S: Final = 0.5
"""How long after the first answer another autopilot's is waited for."""


@dataclass(frozen=True)
class Identity:
    """One autopilot: the number of its hardware (hexadecimal; empty when it tells none) and its firmware."""

    uid: str
    firmware: str

    @classmethod
    def of(cls, message: Message) -> Identity:
        """Return what an AUTOPILOT_VERSION says."""
        number = message.uid.to_bytes(8, "big") + bytes(message.uid2)
        version = message.flight_sw_version
        return cls(
            uid=number.hex() if any(number) else "",
            firmware=f"{version >> 24}.{version >> 16 & 0xFF}.{version >> 8 & 0xFF}",
        )


async def read_identities(vehicle: Vehicle) -> frozenset[Identity]:
    """Return every autopilot that answers for the vehicle: one, unless a system id is given twice; none in silence."""
    found: set[Identity] = set()

    def take(message: Message) -> None:
        found.add(Identity.of(message))

    with vehicle.hearing(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, take):
        for _ in range(TRIES):
            vehicle.tell(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            if await vehicle.holds_within(PATIENCE_S, lambda: bool(found)):
                await vehicle.clock.sleep(_OTHERS_S)
                break
    return frozenset(found)
