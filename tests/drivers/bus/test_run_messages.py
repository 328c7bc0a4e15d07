"""What is said of a run is decoded by its schema; what another version adds is passed over; no recording repeats it."""

from __future__ import annotations

import jsonschema
import msgspec
import pytest
import zenoh

from drivers.bus.keys import SwarmKeys, uav_of
from drivers.bus.messages import MalformedMessageError, encode
from drivers.bus.run_messages import (
    KINDS,
    Events,
    EventsRequest,
    ProvenRequest,
    RunEvent,
    RunState,
    decode_run,
    run_json_schemas,
)

STATE = RunState("run-1", 3, 5, 6, "relay", 1.5)
KEYS = SwarmKeys("paper-8")


def test_what_is_not_known_is_not_said() -> None:
    assert msgspec.json.decode(encode(STATE)) == {
        "run": "run-1", "number": 3, "time_ns": 5, "sent_ns": 6, "phase": "relay", "elapsed_s": 1.5,
    }  # fmt: skip
    assert decode_run(encode(STATE), RunState) == STATE


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (b"", RunState),
        (b"[]", RunState),
        (b"{}", RunState),
        (encode(STATE).replace(b'"number":3', b'"number":-3'), RunState),
        (encode(STATE).replace(b'"number":3', b'"number":"3"'), RunState),
        (encode(STATE).replace(b"1.5", b"null"), RunState),
        (encode(STATE).replace(b"1.5", b"NaN"), RunState),
        (b'{"first":-1}', EventsRequest),
        (b'{"verb":"hold","said_ns":1,"proof":""}', ProvenRequest),
        (b'{"verb":"fly","said_ns":1,"proof":"x"}', ProvenRequest),
        (b'{"verb":"hold","said_ns":1,"proof":"x","more":1}', ProvenRequest),
    ],
)
def test_what_is_malformed_is_refused(payload: bytes, kind: type[msgspec.Struct]) -> None:
    with pytest.raises(MalformedMessageError):
        decode_run(payload, kind)


def test_a_field_of_another_version_is_passed_over() -> None:
    assert decode_run(encode(STATE)[:-1] + b',"invented_later":[1]}', RunState) == STATE


def test_every_message_has_a_schema_and_keeps_to_it() -> None:
    schemas = run_json_schemas()
    assert {kind.__name__ for kind in KINDS} <= schemas.keys()
    events = Events([RunEvent("run-1", 0, 1, 0.5, "U1 LEG_1", vehicle="U1", leg=1, state="LEG_1")])
    for message in (STATE, events, EventsRequest(5), ProvenRequest("skip", 5, "ab", "U1")):
        schema = {"$defs": schemas, "$ref": f"#/$defs/{type(message).__name__}"}
        jsonschema.validate(msgspec.json.decode(encode(message)), schema)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate("something else", schema)


@pytest.mark.parametrize("key", [KEYS.state, KEYS.events])
def test_who_records_everything_is_spared_what_repeats_it(key: str) -> None:
    everything = zenoh.KeyExpr("bearing-relay/paper-8/**")
    assert not everything.intersects(zenoh.KeyExpr(key))
    assert everything.intersects(zenoh.KeyExpr(KEYS.setup))
    assert everything.intersects(zenoh.KeyExpr(KEYS.progress))
    assert zenoh.KeyExpr(SwarmKeys("*").state).intersects(zenoh.KeyExpr(KEYS.state))


def test_none_of_these_keys_speaks_for_a_vehicle() -> None:
    assert [uav_of(key) for key in (KEYS.setup, KEYS.state, KEYS.events)] == [None, None, None]
