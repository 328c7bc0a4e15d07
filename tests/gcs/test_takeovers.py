"""Setpoints after a take-over: everything that leaves on the wire for a vehicle that is not the service's counts."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.setpoint_messages import position_setpoint, velocity_setpoint
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.takeovers import CountingLogs, Takeovers
from planner.frames import GeodeticPosition
from planner.plan import Route

GUIDED, LOITER = 4, 5
PLACE = GeodeticPosition(47.0, 8.0, 500.0)


@dataclass
class Log:
    """A log that keeps what it is told."""

    frames: list[tuple[str, bytes]] = field(default_factory=list)

    def received(self, frame: bytes) -> None:
        self.frames.append(("received", frame))

    def sent(self, frame: bytes) -> None:
        self.frames.append(("sent", frame))


@dataclass
class Logs:
    kept: dict[str, Log] = field(default_factory=dict)

    def of(self, address: object) -> Log:
        return self.kept.setdefault(str(address), Log())


@dataclass
class Heard:
    """A vehicle as far as it is listened to."""

    name: str
    system_id: int
    on_heartbeat: list = field(default_factory=list)

    def in_mode(self, mode: int) -> None:
        for listener in self.on_heartbeat:
            listener(mode)


def packed(message: mavlink.MAVLink_message) -> bytes:
    return message.pack(mavlink.MAVLink(None, 255, 190))


@pytest.fixture
def rig() -> tuple[Heard, Takeovers, Log, object]:
    logs = Logs()
    counting = CountingLogs(logs)
    takeovers, vehicle = Takeovers(counting.setpoints), Heard("U2", 7)
    takeovers.watch(vehicle, lambda mode: mode == GUIDED)
    return vehicle, takeovers, logs.of("U2"), counting.of("U2")


def test_setpoints_of_either_kind_count_from_the_take_over_on(rig) -> None:
    vehicle, takeovers, _, wire = rig
    for message in (velocity_setpoint(7, 3 + 1j, 0.5), velocity_setpoint(7, 0j, 0.0), position_setpoint(7, PLACE)):
        wire.sent(packed(message))
    vehicle.in_mode(GUIDED)
    assert takeovers.setpoints_after("U2") is None
    vehicle.in_mode(LOITER)
    assert takeovers.setpoints_after("U2") == 0
    wire.sent(packed(velocity_setpoint(7, 0j, 0.0)))
    vehicle.in_mode(LOITER)
    wire.sent(packed(position_setpoint(7, PLACE)))
    assert takeovers.setpoints_after("U2") == 2


def test_what_is_sent_once_it_is_given_back_does_not_count(rig) -> None:
    vehicle, takeovers, _, wire = rig
    vehicle.in_mode(LOITER)
    wire.sent(packed(velocity_setpoint(7, 1 + 0j, 0.0)))
    vehicle.in_mode(GUIDED)
    wire.sent(packed(velocity_setpoint(7, 1 + 0j, 0.0)))
    assert takeovers.setpoints_after("U2") == 1
    vehicle.in_mode(LOITER)
    wire.sent(packed(velocity_setpoint(7, 1 + 0j, 0.0)))
    assert takeovers.setpoints_after("U2") == 2


def test_receivers_are_told_that_a_pilot_has_or_has_had_and_no_others(rig) -> None:
    vehicle, takeovers, _, wire = rig
    vehicle.in_mode(LOITER)
    wire.sent(packed(velocity_setpoint(7, 1 + 0j, 0.0)))
    route = Route("U2", "O2", 1, 1, "I", 0j, 5j, ())
    for state, strayed, expected in (("PILOT", False, 1), ("HELD", True, 1), ("PLACED", False, None)):
        record = ReceiverRecord(route, ReceiverState(state), strayed=strayed)
        assert takeovers.of_receivers({"U2": record}).get("U2") == expected


def test_other_vehicles_other_messages_and_what_came_in_do_not_count(rig) -> None:
    vehicle, takeovers, _, wire = rig
    vehicle.in_mode(LOITER)
    wire.sent(packed(velocity_setpoint(8, 1 + 0j, 0.0)))
    wire.sent(packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    wire.received(packed(velocity_setpoint(7, 1 + 0j, 0.0)))
    assert takeovers.setpoints_after("U2") == 0
    assert takeovers.setpoints_after("U9") is None


def test_every_frame_still_goes_to_the_log(rig) -> None:
    _, _, log, wire = rig
    frames = [packed(velocity_setpoint(7, 1j, 0.0)), packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))]
    wire.sent(frames[0])
    wire.received(frames[1])
    assert log.frames == [("sent", frames[0]), ("received", frames[1])]
