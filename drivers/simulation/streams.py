"""Which reports one link gets, and how often: the rates an ArduPilot keeps per port."""

from __future__ import annotations

from math import floor, inf

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.simulation.parameters import Parameters
from drivers.simulation.telemetry import REPORTS

HEARTBEAT_S = 1.0

GROUPS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
    ),
}
"""What a REQUEST_DATA_STREAM speaks of."""

RATE_PARAMETERS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: "SR0_EXT_STAT",
    mavlink.MAV_DATA_STREAM_POSITION: "SR0_POSITION",
    mavlink.MAV_DATA_STREAM_EXTRA1: "SR0_EXTRA1",
    mavlink.MAV_DATA_STREAM_EXTRA2: "SR0_EXTRA2",
    mavlink.MAV_DATA_STREAM_EXTRA3: "SR0_EXTRA3",
}
"""The parameter, Hz, that says how often a group is sent unasked."""

FASTEST_S = 0.005


class Streams:
    """The reports due on one link; intervals and times in s since switch-on."""

    def __init__(self, parameters: Parameters, now_s: float = 0.0) -> None:
        self._interval_s: dict[int, float] = {}
        self._due_s: dict[int, float] = {}
        self.next_due_s = inf
        self._unasked_s = _unasked_intervals_s(parameters)
        for message_id, interval_s in self._unasked_s.items():
            self.set_interval(message_id, interval_s, now_s)

    def interval_s(self, message_id: int) -> float:
        """Return a report's interval; infinite when it is not sent."""
        return self._interval_s.get(message_id, inf)

    def set_interval(self, message_id: int, interval_s: float | None, now_s: float) -> bool:
        """Send a report at an interval (infinite: not at all; None: as by default); False for an unknown one.

        Reports fall on multiples of their interval, so that many leave at one time.
        """
        if message_id not in REPORTS:
            return False
        if interval_s is None:
            interval_s = self._unasked_s.get(message_id, inf)
        self._interval_s.pop(message_id, None)
        self._due_s.pop(message_id, None)
        if interval_s < inf:
            self._interval_s[message_id] = max(interval_s, FASTEST_S)
            self._due_s[message_id] = self._next_multiple_s(message_id, now_s)
        self._find_next()
        return True

    def set_group(self, group: int, interval_s: float, now_s: float) -> None:
        """Send a group of reports (0: all groups) at an interval."""
        for member, message_ids in GROUPS.items():
            if group in (mavlink.MAV_DATA_STREAM_ALL, member):
                for message_id in message_ids:
                    self.set_interval(message_id, interval_s, now_s)

    def take_due(self, now_s: float) -> list[int]:
        """Return the reports to send now; those missed while nobody asked are not made up for."""
        if now_s < self.next_due_s:
            return []
        due = [message_id for message_id, due_s in self._due_s.items() if due_s <= now_s]
        for message_id in due:
            self._due_s[message_id] = self._next_multiple_s(message_id, now_s)
        self._find_next()
        return due

    def _next_multiple_s(self, message_id: int, now_s: float) -> float:
        interval_s = self._interval_s[message_id]
        return (floor(now_s / interval_s + 1e-6) + 1) * interval_s

    def _find_next(self) -> None:
        self.next_due_s = min(self._due_s.values(), default=inf)


def _unasked_intervals_s(parameters: Parameters) -> dict[int, float]:
    """Return how often each report is sent without any request: the heartbeat, and the groups with a rate."""
    intervals_s = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: HEARTBEAT_S}
    for group, parameter in RATE_PARAMETERS.items():
        if parameters[parameter] > 0.0:
            intervals_s |= dict.fromkeys(GROUPS[group], 1.0 / parameters[parameter])
    return intervals_s
