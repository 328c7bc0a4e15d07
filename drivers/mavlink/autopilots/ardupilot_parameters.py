"""What the parameters of an ArduCopter mean for a flight in GUIDED; of 4.6, and where 4.7 renamed them, of both."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from drivers.mavlink.checks import Finding, Intent, ParameterCheck, Parameters, hard, passed, soft, unread

LONGEST_TIMEOUT_S: Final = 2.0
_DEFAULT_ACCELERATION_CMPS2: Final = 250.0
_DELAY_S: Final = 0.4
"""Between a stop and its effect, in the stopping distances measured on 4.6."""
_DEFAULT_MARGIN_M: Final = 2.0

_FENCE_ALTITUDE, _FENCE_CIRCLE, _FENCE_POLYGON, _FENCE_FLOOR = 1, 2, 4, 8
_RETURNING: Final = frozenset({1, 2, 3, 6})
"""The values of FS_GCS_ENABLE that fly home."""
_IGNORE_PILOT_YAW: Final = 4
_ONLY_FROM_ITS_STATION: Final = 1
"""The bit of MAV_OPTIONS that was SYSID_ENFORCE before."""


def _setpoint_timeout(parameters: Parameters, intent: Intent) -> Finding:
    timeout_s = parameters.get("GUID_TIMEOUT")
    if timeout_s is None:
        return unread("GUID_TIMEOUT")
    acceleration_mps2 = parameters.get("WPNAV_ACCEL", _DEFAULT_ACCELERATION_CMPS2) / 100.0
    speed_mps = intent.speed_mps
    further_m = speed_mps * (timeout_s + _DELAY_S) + speed_mps**2 / (2.0 * acceleration_mps2)
    found = (
        f"GUID_TIMEOUT {timeout_s:g}: without setpoints it hovers after {timeout_s:g} s, "
        f"{further_m:.0f} m further on at {speed_mps:g} m/s"
    )
    if timeout_s > LONGEST_TIMEOUT_S:
        return soft(found, "Set GUID_TIMEOUT to 1.")
    return passed(found)


def _station_failsafe(parameters: Parameters, intent: Intent) -> Finding:
    action = parameters.get("FS_GCS_ENABLE")
    low = parameters.get("SYSID_MYGCS", parameters.get("MAV_GCS_SYSID"))
    if action is None or low is None:
        return unread("FS_GCS_ENABLE" if action is None else "SYSID_MYGCS")
    high = max(low, parameters.get("MAV_GCS_SYSID_HI", 0.0))
    name = "SYSID_MYGCS" if "SYSID_MYGCS" in parameters else "MAV_GCS_SYSID"
    station = f"{low:g}" if high == low else f"{low:g} to {high:g}"
    way_out = f"Set {name} to {intent.station_system_id}, or mavlink.system_id of the playbook to its value."
    if not low <= intent.station_system_id <= high:
        if parameters.get("SYSID_ENFORCE") or int(parameters.get("MAV_OPTIONS", 0.0)) & _ONLY_FROM_ITS_STATION:
            return hard(f"obeys system id {station} only, and this service is {intent.station_system_id}", way_out)
        if action:
            return soft(
                f"its ground-station failsafe waits for system id {station}, not for this service "
                f"({intent.station_system_id}): it acts when another station falls silent, and not when this one does",
                way_out,
            )
    if not action:
        return soft(
            "FS_GCS_ENABLE 0: it hovers until its battery is empty when this service has gone",
            "Set FS_GCS_ENABLE to 5 (land) or, with altitudes apart, 1 (return).",
        )
    return passed(f"FS_GCS_ENABLE {action:g} for system id {station}")


def _geofence(parameters: Parameters, intent: Intent) -> Finding:
    enabled = parameters.get("FENCE_ENABLE")
    if enabled is None:
        return unread("FENCE_ENABLE")
    if not enabled and not parameters.get("FENCE_AUTOENABLE"):
        return passed("FENCE_ENABLE 0: no fence")
    kinds = parameters.get("FENCE_TYPE")
    if kinds is None:
        return unread("FENCE_TYPE")
    breaches = _breaches(int(kinds), parameters, intent)
    if breaches:
        return hard("; ".join(breaches), "Change the fence, or the playbook's altitude or starts.")
    if int(kinds) & _FENCE_POLYGON:
        return soft("FENCE_TYPE has polygons, which are not looked at", "Check that every route lies inside them.")
    return passed("the route lies inside its fence")


def _breaches(kinds: int, parameters: Parameters, intent: Intent) -> list[str]:
    margin_m = parameters.get("FENCE_MARGIN", _DEFAULT_MARGIN_M)
    breaches: list[str] = []

    def limit(kind: int, name: str, breached: Callable[[float], bool], what: str) -> None:
        if kinds & kind and name in parameters and breached(parameters[name]):
            breaches.append(f"{name} {parameters[name]:g} with a margin of {margin_m:g} m: {what}")

    altitude_m, reach_m = intent.altitude_m, intent.reach_m
    limit(_FENCE_ALTITUDE, "FENCE_ALT_MAX", lambda m: altitude_m > m - margin_m, f"it is to fly at {altitude_m:g} m")
    limit(_FENCE_FLOOR, "FENCE_ALT_MIN", lambda m: altitude_m < m + margin_m, f"it is to fly at {altitude_m:g} m")
    limit(_FENCE_CIRCLE, "FENCE_RADIUS", lambda m: reach_m > m - margin_m, f"its route leads {reach_m:.0f} m from home")
    return breaches


def _heading(parameters: Parameters, _intent: Intent) -> Finding:
    behaviour = parameters.get("WP_YAW_BEHAVIOR")
    if behaviour is None:
        return unread("WP_YAW_BEHAVIOR")
    turns = []
    if behaviour:
        turns.append(f"WP_YAW_BEHAVIOR {behaviour:g} turns its nose where no setpoint holds it")
    if not int(parameters.get("GUID_OPTIONS", 0.0)) & _IGNORE_PILOT_YAW:
        turns.append("GUID_OPTIONS lets the yaw stick turn it in GUIDED")
    if turns:
        return soft("; ".join(turns), "For antenna arrays: WP_YAW_BEHAVIOR 0 and GUID_OPTIONS 4.")
    return passed("nothing but a setpoint turns its nose")


def failsafe_return_altitude_m(parameters: Parameters) -> float | None:
    """Return at what height above home it flies home when the station is lost; None when it does not."""
    if parameters.get("FS_GCS_ENABLE") not in _RETURNING:
        return None
    if "RTL_ALT_M" in parameters:
        return parameters["RTL_ALT_M"]
    return parameters["RTL_ALT"] / 100.0 if "RTL_ALT" in parameters else None


PARAMETER_CHECKS: Final = (
    ParameterCheck("setpoint time-out", ("GUID_TIMEOUT", "WPNAV_ACCEL"), _setpoint_timeout),
    ParameterCheck(
        "station failsafe",
        ("FS_GCS_ENABLE", "SYSID_MYGCS", "SYSID_ENFORCE", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI", "MAV_OPTIONS"),
        _station_failsafe,
    ),
    ParameterCheck(
        "geofence",
        (
            *("FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE"),
            *("FENCE_ALT_MAX", "FENCE_ALT_MIN", "FENCE_RADIUS", "FENCE_MARGIN"),
        ),
        _geofence,
    ),
    ParameterCheck("heading", ("WP_YAW_BEHAVIOR", "GUID_OPTIONS"), _heading),
)
RETURN_PARAMETERS: Final = ("FS_GCS_ENABLE", "RTL_ALT", "RTL_ALT_M")
