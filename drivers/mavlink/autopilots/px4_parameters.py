"""What the parameters of a PX4 multicopter mean for a flight in OFFBOARD, as of 1.17."""

from __future__ import annotations

from typing import Final

from drivers.mavlink.checks import Finding, Intent, ParameterCheck, Parameters, hard, passed, soft, unread

LONGEST_TIMEOUT_S: Final = 2.0
SHORTEST_TIMEOUT_S: Final = 0.9
"""The service takes a gap of 0.8 s for the end of OFFBOARD; it must not have ended before."""
_STOPPING_S2_PER_M: Final = 0.35
"""Distance of a stop by loss of the stream over the square of the speed, as measured from 4.4 m/s."""

_OFFBOARD_LOSS: Final = {
    0: "position mode, and home without a remote control",
    1: "altitude mode, and home without a remote control",
    2: "stabilized, and home without a remote control",
    3: "home",
    4: "land",
    5: "hold",
    6: "terminate the flight",
    7: "disarm",
}
_HOME_AFTER_OFFBOARD: Final = frozenset({0, 1, 2, 3})
_STATION_LOSS: Final = {0: "nothing", 1: "hold", 2: "home", 3: "land", 5: "terminate the flight", 6: "disarm"}
_FALLING: Final = frozenset({"terminate the flight", "disarm"})
_IN_OFFBOARD: Final = 4


def _setpoint_timeout(parameters: Parameters, intent: Intent) -> Finding:
    timeout_s = parameters.get("COM_OF_LOSS_T")
    if timeout_s is None:
        return unread("COM_OF_LOSS_T")
    further_m = intent.speed_mps * timeout_s + _STOPPING_S2_PER_M * intent.speed_mps**2
    found = (
        f"COM_OF_LOSS_T {timeout_s:g}: without setpoints it flies on for {timeout_s:g} s, and comes to rest "
        f"{further_m:.0f} m further on at {intent.speed_mps:g} m/s"
    )
    if timeout_s < SHORTEST_TIMEOUT_S:
        return hard(
            f"COM_OF_LOSS_T {timeout_s:g}: OFFBOARD may have ended before the service knows, "
            "and a stream that comes back would seize the vehicle",
            "Set COM_OF_LOSS_T to 1.",
        )
    return soft(found, "Set COM_OF_LOSS_T to 1.") if timeout_s > LONGEST_TIMEOUT_S else passed(found)


def _after_offboard(parameters: Parameters, _intent: Intent) -> Finding:
    action = parameters.get("COM_OBL_RC_ACT")
    if action is None:
        return unread("COM_OBL_RC_ACT")
    what = _OFFBOARD_LOSS.get(int(action), "unknown")
    found = f"COM_OBL_RC_ACT {action:g}: without setpoints, {what}"
    if what in _FALLING:
        return hard(found, "Set COM_OBL_RC_ACT to 5 (hold).")
    return passed(found) if what == "hold" else soft(found, "Set COM_OBL_RC_ACT to 5 (hold).")


def _station_failsafe(parameters: Parameters, _intent: Intent) -> Finding:
    action = parameters.get("NAV_DLL_ACT")
    if action is None:
        return unread("NAV_DLL_ACT")
    what = _STATION_LOSS.get(int(action), "unknown")
    found = f"NAV_DLL_ACT {action:g}: without a ground station, {what}; any station's heartbeat feeds it"
    if what in _FALLING:
        return hard(found, "Set NAV_DLL_ACT to 3 (land).")
    return soft(found, "Set NAV_DLL_ACT to 3 (land).") if what in ("nothing", "unknown") else passed(found)


def _remote_control(parameters: Parameters, _intent: Intent) -> Finding:
    exceptions = parameters.get("COM_RCL_EXCEPT")
    if exceptions is None:
        return unread("COM_RCL_EXCEPT")
    found = f"COM_RCL_EXCEPT {exceptions:g}"
    if int(exceptions) & _IN_OFFBOARD:
        return passed(f"{found}: OFFBOARD goes on without a remote control")
    return soft(f"{found}: a lost remote control ends OFFBOARD", "Add 4 to it where the pilot's may be out of reach.")


def _geofence(parameters: Parameters, intent: Intent) -> Finding:
    action = parameters.get("GF_ACTION")
    if action is None:
        return unread("GF_ACTION")
    limits = {
        "GF_MAX_VER_DIST": (intent.altitude_m, f"it is to fly at {intent.altitude_m:g} m"),
        "GF_MAX_HOR_DIST": (intent.reach_m, f"its route leads {intent.reach_m:.0f} m from home"),
    }
    set_limits = {name: parameters[name] for name in limits if parameters.get(name)}
    breaches = [
        f"{name} {limit_m:g}: {limits[name][1]}" for name, limit_m in set_limits.items() if limits[name][0] > limit_m
    ]
    if breaches and action:
        return hard("; ".join(breaches), "Change the fence, or the playbook's altitude or starts.")
    return passed("the route lies inside its fence" if set_limits else "no fence by distance")


def failsafe_return_altitude_m(parameters: Parameters) -> float | None:
    """Return at what height above home it flies home when the station or its stream is lost; None when it does not."""
    homeward = parameters.get("NAV_DLL_ACT") == 2 or parameters.get("COM_OBL_RC_ACT") in _HOME_AFTER_OFFBOARD
    return parameters.get("RTL_RETURN_ALT") if homeward else None


PARAMETER_CHECKS: Final = (
    ParameterCheck("setpoint time-out", ("COM_OF_LOSS_T",), _setpoint_timeout),
    ParameterCheck("after OFFBOARD", ("COM_OBL_RC_ACT",), _after_offboard),
    ParameterCheck("station failsafe", ("NAV_DLL_ACT",), _station_failsafe),
    ParameterCheck("remote control", ("COM_RCL_EXCEPT",), _remote_control),
    ParameterCheck("geofence", ("GF_ACTION", "GF_MAX_VER_DIST", "GF_MAX_HOR_DIST"), _geofence),
)
RETURN_PARAMETERS: Final = ("NAV_DLL_ACT", "COM_OBL_RC_ACT", "RTL_RETURN_ALT")
