"""Which MAVLink frames cross between a vehicle's link at a node and the service: whole, MAVLink 2, its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Subscription
from drivers.mavlink.link_status import LinkState
from drivers.mavlink.timesync import measure_clock
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from gcs.nodes.held_vehicle import Holder
from gcs.nodes.link_node import LinkNode
from gcs.nodes.messages import Command, Refused
from gcs.nodes.remote_link import RemoteLink
from gcs.nodes.tenure import Tenure
from tests.fakes import FakeBus, ManualClock

OWN, OTHER = 3, 4
ADDRESS = LinkAddress("udpin", "127.0.0.1", 14553)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
NO_MAVLINK_2 = "it is no MAVLink 2 frame"
FOR_EVERYBODY = "it is for every system behind the link: a command names its vehicle"
FOR_ANOTHER = "it is for another system"


def disarm(system_id: int) -> Any:
    return mavlink.MAVLink_command_long_message(
        system_id, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 21196, 0, 0, 0, 0, 0
    )


def as_mavlink_1(message: Any, system_id: int = 255) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, system_id, 1), force_mavlink1=True))


class Posted:
    """A held vehicle's link that keeps what is posted to it."""

    def __init__(self) -> None:
        self.posted: list[Any] = []

    def post(self, message: Any) -> None:
        self.posted.append(message)

    post_urgent = post

    def drop_setpoint(self, _system_id: int) -> None:
        pass


def holding() -> tuple[Any, Posted, list[Any]]:
    """What holds the vehicle with the system id OWN, its link, and what it reports."""
    holder: Any = Holder.__new__(Holder)
    link, reported = Posted(), list[Any]()
    holder.tenure, holder.report, holder._codec = Tenure(life=1), reported.append, Codec()
    holder.post, holder.vehicle = SimpleNamespace(system_id=OWN), SimpleNamespace(link=link)
    return holder, link, reported


@pytest.mark.parametrize("urgent", [True, False])
@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (Codec().encode(disarm(0)), FOR_EVERYBODY),
        (Codec().encode(mavlink.MAVLink_param_request_read_message(0, 1, b"SYSID_THISMAV", -1)), FOR_EVERYBODY),
        (Codec().encode(disarm(OTHER)), FOR_ANOTHER),
        (as_mavlink_1(disarm(OWN)), NO_MAVLINK_2),
        (Codec().encode(disarm(OWN))[:-1], NO_MAVLINK_2),
        (Codec().encode(disarm(OWN)) + b"\0", NO_MAVLINK_2),
        (b"\xfe" + Codec().encode(disarm(OWN))[1:], NO_MAVLINK_2),
        (Codec().encode(disarm(OWN))[:12], NO_MAVLINK_2),
        (bytes(300), NO_MAVLINK_2),
    ],
)
def test_what_is_not_one_command_for_the_vehicle_itself_is_refused_and_counted(
    frame: bytes, why: str, urgent: bool
) -> None:
    holder, link, reported = holding()
    holder.take(Command("U1", 1, 0, frame, urgent))
    assert link.posted == []
    assert reported == [Refused("U1", 1, 0, why)]
    assert holder.tenure.refused == {why: 1}


async def test_a_command_of_its_own_and_the_question_for_the_time_are_passed_on() -> None:
    holder, link, reported = holding()
    clock, sent = ManualClock(), list[tuple[bytes, bool]]()
    remote = RemoteLink("north", ADDRESS, Codec(), clock, lambda *frame: sent.append(frame))
    vehicle = Vehicle("U1", OWN, remote, clock)
    remote.post_urgent(disarm(OWN))
    await measure_clock(vehicle, questions=0)
    remote.post(mavlink.MAVLink_timesync_message(0, clock.unix_ns()))
    for frame, urgent in sent:
        holder.take(Command("U1", 1, 0, frame, urgent))
    assert [message.get_type() for message in link.posted] == ["COMMAND_LONG", "TIMESYNC"]
    assert reported == []


def test_a_node_passes_on_mavlink_2_alone_and_counts_the_rest() -> None:
    node = LinkNode("north", "eight", FakeBus(), ManualClock(), lambda _: None)  # type: ignore[arg-type]
    node._wanted[str(ADDRESS), OWN] = "U1", frozenset({mavlink.MAVLINK_MSG_ID_HEARTBEAT})
    frame = Codec(OWN, 1).encode(HEARTBEAT)
    alike = b"\xfe" + frame[1:]  # where MAVLink 2 has its ids it has the vehicle's
    node.pass_on(str(ADDRESS), bytearray(alike))
    node.pass_on(str(ADDRESS), bytearray(as_mavlink_1(HEARTBEAT, OWN)))
    assert not node._telemetry
    assert node.tenure.refused == {"no MAVLink 2 frame": 2}
    node.pass_on(str(ADDRESS), bytearray(frame))
    assert node._telemetry == {"U1": [frame]}


def test_frames_that_are_not_the_vehicle_s_neither_reach_it_nor_keep_its_link_up() -> None:
    clock, heard = ManualClock(), list[Any]()
    link = RemoteLink("north", ADDRESS, Codec(), clock, lambda *_: None)
    link.listen(Subscription(OWN, frozenset({mavlink.MAVLINK_MSG_ID_HEARTBEAT}), heard.append))
    frame = Codec(OWN, 1).encode(HEARTBEAT)
    wrong = [
        as_mavlink_1(HEARTBEAT, OWN),
        b"\xfe" + frame[1:],
        frame[:-1],
        frame[:-1] + bytes([frame[-1] ^ 1]),
        Codec(OTHER, 1).encode(HEARTBEAT),
        Codec(OWN, 2).encode(HEARTBEAT),
        bytes(12),
    ]
    for each in wrong:
        link.receive(each)
    status = link.status(clock.now_s())
    assert heard == []
    assert (status.state, status.received, status.dropped) == (LinkState.CONNECTING, 0, len(wrong))
    link.receive(frame)
    status = link.status(clock.now_s())
    assert [message.get_type() for message in heard] == ["HEARTBEAT"]
    assert (status.state, status.received) == (LinkState.UP, 1)
