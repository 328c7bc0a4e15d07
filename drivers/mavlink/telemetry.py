"""What a vehicle has said of itself: the latest of everything."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Message
from planner.frames import GeodeticPosition

_STATUS_TEXTS_KEPT: Final = 20
_UNKNOWN_MV: Final = 65535
_UNKNOWN_HEADING: Final = 65535
_POLE_E7: Final = 90 * 10**7
_DATE_LINE_E7: Final = 180 * 10**7


@dataclass(frozen=True)
class Heartbeat:
    """What the last heartbeat said, and when it came (this service's clock, s)."""

    time_s: float
    vehicle_type: int
    autopilot: int
    custom_mode: int
    armed: bool
    system_status: int

    @classmethod
    def of(cls, message: Message, time_s: float) -> Heartbeat:
        """Return what a HEARTBEAT says."""
        return cls(
            time_s=time_s,
            vehicle_type=message.type,
            autopilot=message.autopilot,
            custom_mode=message.custom_mode,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            system_status=message.system_status,
        )


@dataclass(frozen=True)
class Kinematics:
    """Where the vehicle says it is and how it moves. For safety, screens and the score; never for a stop decision."""

    time_s: float
    position: GeodeticPosition
    velocity_ned_mps: tuple[float, float, float]
    heading_rad: float | None = None
    """Azimuth of the nose; None when it does not say."""

    @classmethod
    def of(cls, message: Message, time_s: float) -> Kinematics | None:
        """Return what a GLOBAL_POSITION_INT says; None when that is no place on Earth."""
        if abs(message.lat) > _POLE_E7 or abs(message.lon) > _DATE_LINE_E7:
            return None
        return cls(
            time_s=time_s,
            position=GeodeticPosition(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3),
            velocity_ned_mps=(message.vx * 0.01, message.vy * 0.01, message.vz * 0.01),
            heading_rad=None if message.hdg == _UNKNOWN_HEADING else math.radians(message.hdg * 0.01),
        )


@dataclass(frozen=True)
class Battery:
    """What an autopilot knows of its battery; None is what it does not measure."""

    percent: int | None
    voltage_v: float | None

    @classmethod
    def of(cls, message: Message) -> Battery:
        """Return what a SYS_STATUS says of it."""
        percent, voltage_mv = message.battery_remaining, message.voltage_battery
        return cls(
            percent=percent if percent >= 0 else None,
            voltage_v=voltage_mv * 1e-3 if 0 < voltage_mv < _UNKNOWN_MV else None,
        )


@dataclass
class Telemetry:
    """The latest of everything a vehicle has said."""

    last_message_s: float = float("-inf")
    heartbeat: Heartbeat | None = None
    kinematics: Kinematics | None = None
    relative_altitude_m: float | None = None
    estimator_flags: int = 0
    sensors_healthy: int = 0
    """MAV_SYS_STATUS_SENSOR bits of what the autopilot calls healthy."""
    battery: Battery | None = None
    status_texts: deque[str] = field(default_factory=lambda: deque(maxlen=_STATUS_TEXTS_KEPT))
