"""What is on the bus is decoded strictly, comes back as it was, and is what the published schema says."""

import json
import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.messages import (
    Ailment,
    AilmentKind,
    Bearing,
    BearingReport,
    ClockPing,
    ClockPong,
    ControlReply,
    ControlRequest,
    Emission,
    MalformedMessageError,
    PositionReport,
    Progress,
    SensorFault,
    decode,
    encode,
    json_schemas,
)

KINDS = (
    *(BearingReport, PositionReport, Emission, SensorFault, Progress, ClockPing, ClockPong),
    *(ControlRequest, ControlReply),
)
BEARING = {"transmitter": "L0", "azimuth_rad": 1.5, "sigma_rad": 0.01}
REPORT = {"captured_ns": 17, "sequence": 3, "reference": "true_north", "bearings": [BEARING]}
POSITION = {"time_ns": 5, "north_m": 1.0, "east_m": -2.0, "down_m": -10.0, "north_mps": 0.5, "east_mps": 0.0}
CONTROL = {"verb": "release", "vehicle": "U1"}
PROGRESS = {"time_ns": 5, "receiver": "U1", "state": "LEG_1", "reason": ""}

times_ns = st.integers(0, 2**63 - 1)
names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=64)
metres, speeds = st.floats(-1e7, 1e7), st.floats(-1e3, 1e3)
bearings = st.builds(
    Bearing, transmitter=names, azimuth_rad=st.floats(-math.tau, math.tau), sigma_rad=st.floats(1e-9, 3.14)
)
messages = st.one_of(
    st.builds(
        BearingReport,
        captured_ns=times_ns,
        sequence=st.integers(0, 2**53),
        reference=st.sampled_from(["true_north", "body"]),
        bearings=st.lists(bearings, max_size=8),
        captured_uncertainty_ns=st.integers(0, 2**53),
        clock=st.just("") | names,
        resolution_rad=st.floats(0.0, 0.17),
    ),
    st.builds(
        PositionReport,
        time_ns=times_ns,
        north_m=metres,
        east_m=metres,
        down_m=metres,
        north_mps=speeds,
        east_mps=speeds,
        heading_rad=st.none() | st.floats(-math.tau, math.tau),
    ),
    st.builds(Emission, on=st.booleans()),
    st.builds(
        SensorFault,
        silent=st.booleans(),
        muted=st.booleans(),
        ailments=st.lists(
            st.builds(
                Ailment,
                kind=st.sampled_from(get_args(AilmentKind)),
                amount=st.floats(-1e4, 1e4),
                of=st.none() | names,
            ),
            max_size=3,
        ),
        loss=st.floats(0.0, 1.0),
        jitter_s=st.floats(0.0, 10.0),
    ),
    st.builds(Progress, time_ns=times_ns, receiver=names, state=st.text(), reason=st.text()),
    st.builds(
        ControlRequest,
        verb=st.sampled_from(["hold", "resume", "skip", "release", "abort"]),
        vehicle=st.none() | names,
    ),
    st.builds(ControlReply, ok=st.booleans(), message=st.text()),
    st.builds(ClockPing, asked_ns=times_ns),
    st.builds(ClockPong, asked_ns=times_ns, received_ns=times_ns, answered_ns=times_ns, clock=st.just("") | names),
)


def changed(message, **fields):
    return json.dumps(message | fields).encode()


def without(message, field):
    return json.dumps({name: value for name, value in message.items() if name != field}).encode()


def with_bearing(**fields):
    return changed(REPORT, bearings=[BEARING | fields])


@given(messages)
def test_every_message_comes_back_as_it_was(message):
    assert decode(encode(message), type(message)) == message


def test_a_message_any_language_could_write_is_read():
    report = decode(json.dumps(REPORT, indent=2).encode(), BearingReport)
    assert report == BearingReport(17, 3, "true_north", [Bearing("L0", 1.5, 0.01)])
    assert decode(b'{"on":true}', Emission) == Emission(on=True)


def test_a_whole_number_is_a_length_too():
    assert decode(changed(POSITION, north_m=7), PositionReport).north_m == 7.0


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        pytest.param(with_bearing(azimuth_rad=math.nan), BearingReport, id="NaN"),
        pytest.param(with_bearing(azimuth_rad=math.inf), BearingReport, id="infinity"),
        pytest.param(with_bearing().replace(b"1.5", b"1e400"), BearingReport, id="1e400"),
        pytest.param(with_bearing().replace(b"1.5", b"-1e400"), BearingReport, id="-1e400"),
        pytest.param(with_bearing(azimuth_rad=6.3), BearingReport, id="more than a turn"),
        pytest.param(with_bearing(azimuth_rad=None), BearingReport, id="null azimuth"),
        pytest.param(with_bearing(azimuth_rad="1.5"), BearingReport, id="text for a number"),
        pytest.param(with_bearing(azimuth_rad=True), BearingReport, id="true for a number"),
        pytest.param(with_bearing(sigma_rad=0.0), BearingReport, id="no uncertainty at all"),
        pytest.param(with_bearing(sigma_rad=-0.1), BearingReport, id="negative sigma"),
        pytest.param(with_bearing(sigma_rad=1e3), BearingReport, id="sigma beyond pi"),
        pytest.param(with_bearing(transmitter=""), BearingReport, id="nameless transmitter"),
        pytest.param(with_bearing(transmitter="L" * 65), BearingReport, id="endless name"),
        pytest.param(with_bearing(transmitter=7), BearingReport, id="number for a name"),
        pytest.param(with_bearing(elevation_rad=0.1), BearingReport, id="unknown field of a bearing"),
        pytest.param(changed(REPORT, extra=1), BearingReport, id="unknown field"),
        pytest.param(changed(REPORT, reference="magnetic"), BearingReport, id="unknown reference"),
        pytest.param(changed(REPORT, bearings=[BEARING] * 257), BearingReport, id="oversized list"),
        pytest.param(changed(REPORT, bearings={}), BearingReport, id="object for a list"),
        pytest.param(changed(REPORT, bearings=None), BearingReport, id="null for a list"),
        pytest.param(changed(REPORT, captured_ns=-1), BearingReport, id="before 1970"),
        pytest.param(changed(REPORT, captured_ns=1.5), BearingReport, id="fractional ns"),
        pytest.param(changed(REPORT, captured_ns="17"), BearingReport, id="text for a time"),
        pytest.param(changed(REPORT, sequence=-1), BearingReport, id="negative sequence"),
        pytest.param(without(REPORT, "sequence"), BearingReport, id="missing field"),
        pytest.param(b"[" + json.dumps(REPORT).encode() + b"]", BearingReport, id="a list of one"),
        pytest.param(changed(POSITION, north_m=math.nan), PositionReport, id="NaN position"),
        pytest.param(changed(POSITION, down_m=1e8), PositionReport, id="position off the earth"),
        pytest.param(changed(POSITION, east_mps=2e3), PositionReport, id="impossible speed"),
        pytest.param(without(POSITION, "down_m"), PositionReport, id="position without height"),
        pytest.param(changed(POSITION, lat=47.0), PositionReport, id="unknown field of a position"),
        pytest.param(b'{"on":1}', Emission, id="1 for true"),
        pytest.param(b'{"on":"true"}', Emission, id="text for true"),
        pytest.param(b'{"on":null}', Emission, id="null for true"),
        pytest.param(b"true", Emission, id="a bare value"),
        pytest.param(b"{}", SensorFault, id="empty object"),
        pytest.param(b'{"silent":false,"loss":1.1}', SensorFault, id="a share of more than all"),
        pytest.param(b'{"silent":false,"delay_s":-1}', SensorFault, id="a report before its time"),
        pytest.param(b'{"silent":false,"ailments":[{"kind":"sensor_ill"}]}', SensorFault, id="an unknown ailment"),
        pytest.param(changed(PROGRESS, receiver=""), Progress, id="nameless receiver"),
        pytest.param(changed(PROGRESS, reason=None), Progress, id="null reason"),
        pytest.param(changed(CONTROL, verb="arm"), ControlRequest, id="unknown verb"),
        pytest.param(changed(CONTROL, verb="HOLD"), ControlRequest, id="shouted verb"),
        pytest.param(changed(CONTROL, vehicle=""), ControlRequest, id="nameless vehicle"),
        pytest.param(changed(CONTROL, vehicle=["U1", "U2"]), ControlRequest, id="two vehicles"),
        pytest.param(changed(CONTROL, force=True), ControlRequest, id="unknown field of a request"),
        pytest.param(without(CONTROL, "verb"), ControlRequest, id="no verb"),
        pytest.param(b"", Emission, id="nothing"),
        pytest.param(b'{"on":true}x', Emission, id="more after the end"),
        pytest.param(b'{"on":true', Emission, id="cut off"),
        pytest.param(b"\xff\xfe", Emission, id="no text at all"),
        pytest.param(b'{"on":true}\x00', Emission, id="a zero byte after the end"),
        pytest.param(b"[" * 100_000, Emission, id="bottomless"),
    ],
)
def test_anything_else_is_refused(payload, kind):
    with pytest.raises(MalformedMessageError):
        decode(payload, kind)


def test_the_error_says_which_field_is_wrong_and_how():
    with pytest.raises(MalformedMessageError, match=r"`float`.*\$\.bearings\[0\]\.azimuth_rad"):
        decode(with_bearing(azimuth_rad="north"), BearingReport)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_never_comes_through_even_when_it_is_sent(value):
    payload = encode(BearingReport(1, 1, "body", [Bearing("L0", value, 0.01)]))
    with pytest.raises(MalformedMessageError):
        decode(payload, BearingReport)


@given(st.binary(max_size=200) | st.text(max_size=100).map(str.encode), st.sampled_from(KINDS))
def test_whatever_bytes_come_the_only_error_is_a_malformed_message(payload, kind):
    try:
        decode(payload, kind)
    except MalformedMessageError:
        return


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from([(REPORT, BearingReport), (POSITION, PositionReport), (PROGRESS, Progress)]), st.data())
def test_a_message_with_one_field_replaced_is_refused_or_wholly_typed(sample, data):
    message, kind = sample
    field = data.draw(st.sampled_from(sorted(message)))
    payload = changed(message, **{field: data.draw(json_values)})
    try:
        read = decode(payload, kind)
    except MalformedMessageError:
        return
    assert conforms(json.loads(encode(read)), {"$ref": f"#/$defs/{kind.__name__}"})


def conforms(value, schema):
    """Return whether a value is what a JSON Schema (the part of it that is used here) says."""
    if "$ref" in schema:
        return conforms(value, SCHEMAS["$defs"][schema["$ref"].removeprefix("#/$defs/")])
    assert schema.keys() <= KNOWN_KEYWORDS, "teach conforms() the new keyword"
    if "anyOf" in schema and not any(conforms(value, option) for option in schema["anyOf"]):
        return False
    return all(check(value, schema) for check in (_conforms_type, _conforms_range, _conforms_parts))


KNOWN_KEYWORDS = {
    *("title", "description", "type", "enum", "minimum", "maximum", "exclusiveMinimum", "minLength", "maxLength"),
    *("properties", "required", "additionalProperties", "items", "maxItems", "anyOf", "default"),
}
JSON_TYPES = {
    "null": type(None),
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "integer": int,
    "boolean": bool,
}


def _conforms_type(value, schema):
    kind = schema.get("type")
    if isinstance(value, bool) and kind != "boolean":
        return False
    return (kind is None or isinstance(value, JSON_TYPES[kind])) and value in schema.get("enum", [value])


def _conforms_range(value, schema):
    if isinstance(value, str):
        return schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", math.inf)
    if isinstance(value, (int, float)):
        above = value > schema.get("exclusiveMinimum", -math.inf)
        return above and schema.get("minimum", -math.inf) <= value <= schema.get("maximum", math.inf)
    return True


def _conforms_parts(value, schema):
    if isinstance(value, dict):
        fields = schema["properties"]
        named = set(schema["required"]) <= value.keys() and (
            schema["additionalProperties"] or value.keys() <= fields.keys()
        )
        return named and all(conforms(part, fields[name]) for name, part in value.items())
    if isinstance(value, list):
        return len(value) <= schema["maxItems"] and all(conforms(part, schema["items"]) for part in value)
    return True


SCHEMAS = json_schemas()


def test_the_schema_is_json_and_describes_every_message_by_name():
    published = json.loads(json.dumps(SCHEMAS))
    assert {kind.__name__ for kind in KINDS} <= published["$defs"].keys()
    assert {option["$ref"] for option in published["anyOf"]} == {f"#/$defs/{kind.__name__}" for kind in KINDS}
    for definition in published["$defs"].values():
        assert definition["additionalProperties"] is False
        optional = {name for name, field in definition["properties"].items() if "default" in field}
        assert set(definition["required"]) == definition["properties"].keys() - optional


def test_what_is_optional_is_not_sent_unless_it_says_something():
    assert json.loads(encode(decode(json.dumps(REPORT).encode(), BearingReport))) == REPORT
    assert json.loads(encode(decode(json.dumps(POSITION).encode(), PositionReport))) == POSITION
    full = REPORT | {"captured_uncertainty_ns": 5, "clock": "companion", "resolution_rad": 0.017}
    assert json.loads(encode(decode(json.dumps(full).encode(), BearingReport))) == full


@given(messages)
def test_the_schema_accepts_what_is_sent(message):
    assert conforms(json.loads(encode(message)), {"$ref": f"#/$defs/{type(message).__name__}"})


@pytest.mark.parametrize(
    "payload",
    [
        with_bearing(azimuth_rad=7.0),
        with_bearing(sigma_rad=0.0),
        with_bearing(extra=1),
        changed(REPORT, sequence=-1),
        changed(REPORT, reference="magnetic"),
        changed(REPORT, bearings=[BEARING] * 257),
        without(REPORT, "captured_ns"),
    ],
)
def test_the_schema_refuses_what_decoding_refuses(payload):
    assert not conforms(json.loads(payload), {"$ref": "#/$defs/BearingReport"})
    with pytest.raises(MalformedMessageError):
        decode(payload, BearingReport)
