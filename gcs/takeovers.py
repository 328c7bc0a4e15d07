"""What is still sent to a vehicle that its pilot has taken: setpoints, counted on the wire. There must be none."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.tlog import FrameLog
from drivers.mavlink.vehicle import Heartbeat, Vehicle
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState

_SETPOINTS: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED, mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT}
)
_HEADER_BYTES: Final = 10
_TARGET_SYSTEM: Final = _HEADER_BYTES + struct.calcsize("<I11fH")
"""Where a MAVLink 2 frame of either has the system id it is for: behind a time, eleven numbers and a mask."""


class FrameLogs(Protocol):
    """What keeps a log of every link."""

    def of(self, address: object) -> FrameLog:
        """Return the log of the link with this address."""
        ...


class CountingLogs:
    """Logs of links that count, too: how many setpoints were sent to each system id."""

    def __init__(self, logs: FrameLogs) -> None:
        self.setpoints: Counter[int] = Counter()
        self._logs = logs

    def of(self, address: object) -> FrameLog:
        """Return the log of the link with this address."""
        return _CountingLog(self._logs.of(address), self.setpoints)


@dataclass(frozen=True)
class _CountingLog:
    log: FrameLog
    setpoints: Counter[int]

    def received(self, frame: bytes | bytearray) -> None:
        """Take down a frame that came in."""
        self.log.received(frame)

    def sent(self, frame: bytes) -> None:
        """Take down a frame that was handed to the network."""
        self.log.sent(frame)
        if frame[0] == mavlink.PROTOCOL_MARKER_V2 and int.from_bytes(frame[7:10], "little") in _SETPOINTS:
            self.setpoints[frame[_TARGET_SYSTEM]] += 1


@dataclass
class Takeovers:
    """Who has had vehicles beside the service, and the setpoints that went to them meanwhile."""

    setpoints: Counter[int]
    _taken_at: dict[str, int] = field(default_factory=dict)
    """How many setpoints each vehicle had been sent when it was taken."""
    _given_back: Counter[str] = field(default_factory=Counter)
    _system_ids: dict[str, int] = field(default_factory=dict)
    _told: dict[str, Callable[[], int | None]] = field(default_factory=dict)

    def ask(self, name: str, setpoints_after: Callable[[], int | None]) -> None:
        """Have somebody else tell how many setpoints a vehicle was sent while it was not the service's."""
        self._told[name] = setpoints_after

    def watch(self, vehicle: Vehicle, is_guided: Callable[[Heartbeat], bool]) -> None:
        """Follow a vehicle that is in guided flight now: any other mode from now on takes it from the service."""
        name, system_id = vehicle.name, vehicle.system_id
        self._system_ids[name] = system_id

        def look(heartbeat: Heartbeat) -> None:
            if not is_guided(heartbeat):
                self._taken_at.setdefault(name, self.setpoints[system_id])
            elif name in self._taken_at:
                self._given_back[name] += self.setpoints[system_id] - self._taken_at.pop(name)

        vehicle.on_heartbeat.append(look)

    def of_receivers(self, records: Mapping[str, ReceiverRecord]) -> dict[str, int]:
        """Return how many setpoints each receiver that a pilot has had was sent meanwhile."""
        lost = [name for name, record in records.items() if record.strayed or record.state is ReceiverState.PILOT]
        sent = {name: self.setpoints_after(name) for name in lost}
        return {name: count for name, count in sent.items() if count is not None}

    def setpoints_after(self, name: str) -> int | None:
        """Return how many setpoints a vehicle was sent while it was not the service's; None when it always was."""
        if name in self._told:
            return self._told[name]()
        if name not in self._taken_at and name not in self._given_back:
            return None
        since = self.setpoints[self._system_ids[name]] - self._taken_at[name] if name in self._taken_at else 0
        return since + self._given_back[name]
