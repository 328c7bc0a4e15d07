"""The messages between the service and its nodes: strict, with schemas, and nothing that flies a vehicle by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import SetpointError
from drivers.mavlink.codec import Codec
from drivers.mavlink.link import Setpoint
from drivers.mavlink.setpoint_messages import velocity_setpoint
from drivers.mavlink.transport import LinkAddress
from gcs.errors import ServiceError
from gcs.nodes.held_vehicle import PASSED_ON, Holder
from gcs.nodes.messages import (
    Beat,
    Command,
    FlyLeg,
    Grant,
    HeldVehicle,
    LegNotes,
    Refused,
    VehicleGrant,
    decode_beat,
    decode_grant,
    decode_order,
    decode_report,
    encode,
    node_json_schemas,
)
from gcs.nodes.remote_link import RemoteLink
from gcs.nodes.tenure import Tenure
from gcs.playbook.loader import load_playbook
from gcs.relay.settings import RelaySettings
from gcs.traced_monitor import MonitorNote
from tests.fakes import ManualClock

NOTES = [MonitorNote(1, 0.1, begun=True), MonitorNote(2, 0.1, commanded_mps=(1.0, -0.25))]
MESSAGES: list[tuple[Any, Any]] = [
    (Beat(1, 2, {"U1": HeldVehicle(3, open=True)}, {"old token": 4}), decode_beat),
    (Grant(1, 2, 3, {"U1": VehicleGrant(3, 1, "only 2.0 m from U2")}), decode_grant),
    (FlyLeg("U1", 3, 1, 0, RelaySettings(), None, NOTES), decode_order),
    (Command("U1", 3, 0, bytes(range(20)), urgent=True), decode_order),
    (LegNotes("U1", 3, 1, 0, NOTES, "slow"), decode_report),
]


@pytest.mark.parametrize(("message", "decode"), MESSAGES)
def test_what_is_said_is_understood_and_as_its_schema_has_it(message: Any, decode: Any) -> None:
    payload = encode(message)
    assert decode(payload) == message
    schemas = {"$defs": node_json_schemas()}
    jsonschema.validate(json.loads(payload), schemas | {"$ref": f"#/$defs/{type(message).__name__}"})


@pytest.mark.parametrize(("message", "decode"), MESSAGES)
def test_what_is_more_than_a_message_or_cut_off_is_none(message: Any, decode: Any) -> None:
    payload = encode(message)
    with pytest.raises(msgspec.MsgspecError):
        decode(payload[:-1])
    with pytest.raises(msgspec.MsgspecError):
        decode(payload[:-1] + b',"more":1}')


async def test_no_setpoint_crosses_the_bus() -> None:
    """Neither does the service send one, nor would a node pass it on."""
    clock, sent = ManualClock(), list[bytes]()
    link = RemoteLink(
        "north", LinkAddress("udpin", "127.0.0.1", 1), Codec(), clock, lambda frame, _: sent.append(frame)
    )
    setpoint = velocity_setpoint(1, 1 + 1j, 0.0)
    with pytest.raises(SetpointError, match="no setpoint crosses the bus"):
        link.post_setpoint(1, Setpoint(setpoint, 1e9, stops=False))
    assert not sent
    assert setpoint.get_msgId() not in PASSED_ON
    tenure, refused = Tenure(life=1), list[Any]()
    holder: Any = Holder.__new__(Holder)
    holder.tenure, holder.report, holder._codec, holder.vehicle = tenure, refused.append, Codec(), None
    holder.take(Command("U1", 1, 0, Codec().encode(setpoint)))
    assert refused == [Refused("U1", 1, 0, "it is no command")]
    assert tenure.refused == {"it is no command": 1}


async def test_a_command_that_the_service_posts_is_one_that_a_node_passes_on() -> None:
    clock, sent = ManualClock(), list[tuple[bytes, bool]]()
    link = RemoteLink("north", LinkAddress("udpin", "127.0.0.1", 1), Codec(), clock, lambda *frame: sent.append(frame))
    link.post_urgent(mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 17, 0, 0, 0, 0, 0))
    frame, urgent = sent[0]
    message = Codec().decode(bytearray(frame))
    assert urgent
    assert message is not None
    assert message.get_msgId() in PASSED_ON


@pytest.mark.parametrize(
    ("vehicle", "problem"),
    [
        ("{link: 'udpin:127.0.0.1:14551', fallback: ['udpin:127.0.0.1:14559'], system_id: 1, node: north}", "fallback"),
        ("{link: 'udpin:127.0.0.1:14552', system_id: 1, node: north}", "a link is at one"),
    ],
)
def test_a_playbook_says_what_a_node_cannot_have(tmp_path: Path, vehicle: str, problem: str) -> None:
    path = tmp_path / "nodes.yaml"
    path.write_text(PLAYBOOK.replace("{link: 'udpin:127.0.0.1:14551', system_id: 1, node: north}", vehicle))
    with pytest.raises(ServiceError, match=problem):
        load_playbook(path)


def test_nodes_need_a_router_that_they_can_reach(tmp_path: Path) -> None:
    path = tmp_path / "nodes.yaml"
    path.write_text(PLAYBOOK)
    assert load_playbook(path).nodes == {"L0": "north", "U1": "south"}
    path.write_text(PLAYBOOK.replace("bus: {router: 'tcp/127.0.0.1:7447'}\n", ""))
    with pytest.raises(ServiceError, match="link nodes need a router"):
        load_playbook(path)


PLAYBOOK = """\
playbook: 1
name: nodes
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters: {L0: {at: [0, 0]}, L1: {at: [100, 0]}}
receivers: {U1: {start: [20, 30]}}
vehicles:
  L0: {link: 'udpin:127.0.0.1:14551', system_id: 1, node: north}
  L1: {link: 'udpin:127.0.0.1:14552', system_id: 2}
  U1: {link: 'udpin:127.0.0.1:14553', system_id: 3, node: south}
bus: {router: 'tcp/127.0.0.1:7447'}
"""
