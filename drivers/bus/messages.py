"""Messages on the bus: JSON, strictly decoded. Angles in rad, lengths in m, times in ns since 1970-01-01 UTC."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec

from drivers.strict_json import ESCAPES, malformed

Azimuth = Annotated[float, msgspec.Meta(ge=-6.2832, le=6.2832, description="clockwise from the reference, rad")]
Sigma = Annotated[float, msgspec.Meta(gt=0.0, le=3.1416, description="standard deviation, rad")]
Metres = Annotated[float, msgspec.Meta(ge=-1e7, le=1e7)]
MetresPerSecond = Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)]
LARGEST: Final = 2**63 - 1
"""The largest whole number in a message: what any language can hold, and a float can be made of."""
Count = Annotated[int, msgspec.Meta(ge=0, le=LARGEST)]
UnixNs = Annotated[int, msgspec.Meta(ge=0, le=LARGEST, description="ns since 1970-01-01 UTC")]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
DurationNs = Annotated[int, msgspec.Meta(ge=0, le=LARGEST, description="ns")]
ClockName = Annotated[str, msgspec.Meta(max_length=64, description="which clock it is; empty: the UAV's only one")]

COARSEST_RAD: Final = 0.175
"""10 degrees. Nobody is guided by bearings in larger steps: between two of them only commands would say where it is."""
LEAST_SIGMA_RAD: Final = math.radians(0.01)
"""No bearing claims to be better than this; one that claims it says that it is free of noise."""


class Bearing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bearing: azimuth from the receiver to a transmitter."""

    transmitter: Name
    azimuth_rad: Azimuth
    sigma_rad: Sigma


class BearingReport(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What one receiver's AOA sensor measured at one instant. Times are by the sensor's clock."""

    captured_ns: UnixNs
    sequence: Count
    reference: Literal["true_north", "body"]
    bearings: Annotated[list[Bearing], msgspec.Meta(max_length=256)]
    captured_uncertainty_ns: DurationNs = 0
    clock: ClockName = ""
    resolution_rad: Annotated[float, msgspec.Meta(ge=0.0, le=COARSEST_RAD)] = 0.0
    """The step in which azimuths come, 0 when they come in none: a sensor with a step may repeat itself."""


class PositionReport(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Where a UAV is, site frame (north, east, down of the swarm's origin). For safety, screens, simulated sensors."""

    time_ns: UnixNs
    north_m: Metres
    east_m: Metres
    down_m: Metres
    north_mps: MetresPerSecond
    east_mps: MetresPerSecond
    heading_rad: Azimuth | None = None
    """Where the nose points, clockwise from true north."""


class Emission(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether a UAV should transmit."""

    on: bool


AilmentKind = Literal["sensor_stuck", "sensor_bias", "sensor_jump", "clock_step", "clock_drift"]


class Ailment(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a simulated sensor does wrong: by how much, in rad, s or s/s; in the bearings of one transmitter, or all."""

    kind: AilmentKind
    amount: Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)] = 0.0
    of: Name | None = None


class SensorFault(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """All that is wrong from now on with a UAV's simulated sensor, and with how its reports arrive."""

    silent: bool
    muted: bool = False
    """Whether no sensor hears its transmitter any more."""
    ailments: Annotated[list[Ailment], msgspec.Meta(max_length=256)] = []
    loss: Share = 0.0
    """Of reports; the following, too."""
    duplication: Share = 0.0
    reordering: Share = 0.0
    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    jitter_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0


class Progress(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One state change of one receiver in the relay."""

    time_ns: UnixNs
    receiver: Name
    state: str
    reason: str


class ClockPing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asks a sensor for its clock."""

    asked_ns: UnixNs


class ClockPong(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Answers a ClockPing: when it came and when this left, by the sensor's clock; `asked_ns` as it was asked."""

    asked_ns: UnixNs
    received_ns: UnixNs
    answered_ns: UnixNs
    clock: ClockName = ""


class ControlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The operator's word to the relay. `skip` takes a receiver, `release` any vehicle, `takeover` a link node."""

    verb: Literal["hold", "resume", "skip", "release", "abort", "takeover"]
    vehicle: Name | None = None


class ControlReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was done, or why not and the way out."""

    ok: bool
    message: str


AnyMessage = TypeVar("AnyMessage", bound=msgspec.Struct)

_ENCODER: Final = msgspec.json.Encoder()
_DECODERS: Final[dict[type[msgspec.Struct], msgspec.json.Decoder[Any]]] = {
    kind: msgspec.json.Decoder(kind, strict=True)
    for kind in (
        *(BearingReport, PositionReport, Emission, SensorFault, Progress),
        *(ClockPing, ClockPong),
        *(ControlRequest, ControlReply),
    )
}
KINDS: Final = tuple(_DECODERS)
"""Every message between sensors, the service and the operator."""

MalformedMessageError = msgspec.MsgspecError


def encode(message: msgspec.Struct) -> bytes:
    """Return the JSON of a message."""
    return _ENCODER.encode(message)


def decode(payload: bytes, kind: type[AnyMessage]) -> AnyMessage:
    """Return the message a payload holds; MalformedMessageError says which field is wrong and how."""
    try:
        message: AnyMessage = _DECODERS[kind].decode(payload)
    except ESCAPES as error:
        raise malformed(error) from None
    return message


def json_schemas() -> dict[str, Any]:
    """Return the JSON Schema of every message, by name."""
    schemas, components = msgspec.json.schema_components(_DECODERS, ref_template="#/$defs/{name}")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$defs": components, "anyOf": list(schemas)}
