"""What people call the mode that a heartbeat tells: for screens, never for a decision."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.telemetry import Heartbeat

_COPTER: Final = MappingProxyType(
    {
        number: entry.name.removeprefix("COPTER_MODE_")
        for number, entry in mavlink.enums["COPTER_MODE"].items()
        if not entry.name.endswith("ENUM_END")
    }
)

# PX4 tells a main mode, and of AUTO which one: bits 16 to 23, and 24 to 31.
_PX4_MAIN: Final = MappingProxyType(
    {
        1: "MANUAL",
        2: "ALTCTL",
        3: "POSCTL",
        4: "AUTO",
        5: "ACRO",
        6: "OFFBOARD",
        7: "STABILIZED",
        8: "RATTITUDE",
    }
)
_PX4_AUTO: Final = MappingProxyType(
    {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW", 9: "PRECLAND"}
)


def mode_name(heartbeat: Heartbeat | None) -> str:
    """Return the mode's name; its number where nobody knows one, and nothing before the first heartbeat."""
    if heartbeat is None:
        return ""
    mode = heartbeat.custom_mode
    if heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4:
        main, auto = mode >> 16 & 0xFF, mode >> 24 & 0xFF
        name = _PX4_AUTO.get(auto) if main == 4 else None
        return name or _PX4_MAIN.get(main) or str(mode)
    return _COPTER.get(mode, str(mode)) if heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else str(mode)
