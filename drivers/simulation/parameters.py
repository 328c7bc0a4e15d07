"""The parameters of an ArduCopter that this one has: those it acts on, and a few that stations look for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9  # MAV_PARAM_TYPE


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: its default in ArduPilot's own unit, its type on the wire and its range."""

    name: str
    default: float
    kind: int = REAL32
    lowest: float = -1e9
    highest: float = 1e9


EFFECTIVE = (
    Parameter("SYSID_THISMAV", 1, INT16, 1, 255),
    Parameter("SYSID_MYGCS", 255, INT16, 1, 255),
    Parameter("FS_GCS_ENABLE", 0, INT8, 0, 7),
    Parameter("FS_GCS_TIMEOUT", 5, REAL32, 2, 120),
    Parameter("GUID_TIMEOUT", 3, REAL32, 0.1, 5),
    Parameter("WPNAV_SPEED", 1000, REAL32, 10, 2000),  # cm/s
    Parameter("WPNAV_SPEED_UP", 250, REAL32, 10, 1000),  # cm/s
    Parameter("WPNAV_SPEED_DN", 150, REAL32, 10, 500),  # cm/s
    Parameter("WPNAV_ACCEL", 250, REAL32, 50, 500),  # cm/s2
    Parameter("WPNAV_ACCEL_Z", 100, REAL32, 50, 500),  # cm/s2
    Parameter("PSC_JERK_XY", 5, REAL32, 1, 20),  # m/s3
    Parameter("PSC_JERK_Z", 5, REAL32, 5, 50),  # m/s3
    Parameter("WP_YAW_BEHAVIOR", 2, INT8, 0, 3),
    Parameter("RTL_ALT", 1500, INT32, 200, 300000),  # cm
    Parameter("RTL_LOIT_TIME", 5000, INT32, 0, 60000),  # ms
    Parameter("LAND_SPEED", 50, INT16, 30, 200),  # cm/s
    Parameter("LAND_ALT_LOW", 1000, REAL32, 100, 10000),  # cm
    Parameter("DISARM_DELAY", 10, INT8, 0, 127),  # s
    Parameter("BATT_CAPACITY", 5000, INT32, 1, 1000000),  # mAh
    Parameter("SR0_EXT_STAT", 2, INT16, 0, 50),  # Hz, as are the other SR0_
    Parameter("SR0_POSITION", 4, INT16, 0, 50),
    Parameter("SR0_EXTRA1", 4, INT16, 0, 50),
    Parameter("SR0_EXTRA2", 2, INT16, 0, 50),
    Parameter("SR0_EXTRA3", 1, INT16, 0, 50),
    Parameter("SIM_WIND_SPD", 0, REAL32, 0, 30),  # m/s
    Parameter("SIM_WIND_DIR", 180, REAL32, -360, 360),  # deg, where it comes from
    Parameter("SIM_WIND_TURB", 0, REAL32, 0, 10),  # m/s
)

INERT = (
    Parameter("ARMING_CHECK", 1, INT32),
    Parameter("AVOID_ENABLE", 3, INT8),
    Parameter("FENCE_ALT_MAX", 100, REAL32),
    Parameter("FENCE_ENABLE", 0, INT8),
    Parameter("FENCE_MARGIN", 2, REAL32),
    Parameter("FENCE_RADIUS", 300, REAL32),
    Parameter("FENCE_TYPE", 7, INT8),
    Parameter("FRAME_CLASS", 1, INT8),
    Parameter("FRAME_TYPE", 0, INT8),
    Parameter("FS_THR_ENABLE", 0, INT8),
    Parameter("GUID_OPTIONS", 0, INT32),
    Parameter("LOG_BACKEND_TYPE", 0, INT8),
    Parameter("SCHED_LOOP_RATE", 400, INT16),
    Parameter("SYSID_ENFORCE", 0, INT8),
    Parameter("TERRAIN_ENABLE", 0, INT8),
)
"""Kept and reported, without effect: there are no sticks, fence, terrain, logs or further checks here."""

TABLE = tuple(sorted(EFFECTIVE + INERT, key=lambda parameter: parameter.name))


class Parameters:
    """The present value of every parameter, by name or by index."""

    def __init__(self) -> None:
        self._index = {parameter.name: index for index, parameter in enumerate(TABLE)}
        self._values = {parameter.name: parameter.default for parameter in TABLE}
        self.version = 0  # counts changes

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(TABLE)

    def index_of(self, name: str) -> int:
        """Return the position of a parameter in the list a station downloads."""
        return self._index[name]

    def kind_of(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE of a parameter."""
        return TABLE[self._index[name]].kind

    def set(self, name: str, value: float) -> bool:
        """Change a parameter, rounded and limited to its range; an unknown name or no number changes nothing."""
        if name not in self._values or not isfinite(value):
            return False
        parameter = TABLE[self._index[name]]
        limited = min(max(value, parameter.lowest), parameter.highest)
        self._values[name] = limited if parameter.kind == REAL32 else float(round(limited))
        self.version += 1
        return True
