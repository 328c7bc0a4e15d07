"""What the service and its link nodes say to each other on the bus: JSON, strictly decoded, schemas published.

A `token` says for whom a vehicle is held: it grows with every new holder and never falls. Times in s and ns are of the
clock of whoever says them, and are compared with nothing else. Frames are MAVLink 2, base64 in JSON.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec

from drivers.bus.messages import Name
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import Reference
from gcs.relay.settings import RelaySettings
from gcs.traced_monitor import MonitorNote, SetUp

Count = Annotated[int, msgspec.Meta(ge=0)]
Token = Annotated[int, msgspec.Meta(ge=1)]
SystemId = Annotated[int, msgspec.Meta(ge=1, le=255)]
Seconds = Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)]
Frame = Annotated[bytes, msgspec.Meta(min_length=12, max_length=300)]


class _Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Base of all: nothing unknown in it."""


# --- the node's sign of life, and the service's answer to it


class HeldVehicle(_Message, frozen=True):
    """A vehicle as its node has it."""

    token: Token
    open: bool
    """Whether its link is."""
    state: StreamState | None = None
    """What its setpoint stream does; None: it has none."""
    stops: Count = 0
    """The service's last word to stop that came here."""
    order: Count = 0
    """The last of the orders for it that came here."""
    to_pilot: Count | None = None
    """How many setpoints it was sent while it was not the service's; None: it always was."""
    problem: str = ""
    """Why its link is not open, or why it is not released."""


class Beat(_Message, frozen=True):
    """A node lives, `stamp_ns` by its own clock. `life` is another one whenever it has begun anew."""

    life: Count
    stamp_ns: Count
    vehicles: dict[Name, HeldVehicle] = {}
    refused: dict[str, Count] = {}
    """How much it has not done that was said to it, by why."""


class VehicleGrant(_Message, frozen=True):
    """The right to move a vehicle. `stops` grows with every word to stop; a leg begun before it has ended."""

    token: Token
    stops: Count = 0
    objection: str = ""
    """Why it must not move now, by what the service knows; empty when it may."""


class Grant(_Message, frozen=True):
    """Answers a beat: these vehicles are the node's to move, for a while from its `stamp_ns` on, by the node's clock.

    However late it comes, it lasts no longer. The latest `number` counts.
    """

    life: Count
    stamp_ns: Count
    number: Count
    vehicles: dict[Name, VehicleGrant]


# --- orders of the service


class Post(_Message, frozen=True):
    """A vehicle, how it is reached and how it is flown."""

    token: Token
    system_id: SystemId
    link: str
    message_ids: list[Count]
    """The messages of its autopilot that the service wants passed on."""
    altitude_m: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
    speed_mps: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)]
    lease_s: Seconds
    autopilot: str | None = None
    key_file: str | None = None
    """Where the signing key of its link is on the node's machine..."""
    key_variable: str | None = None
    """...or in its environment."""


class Assign(_Message, frozen=True, tag="assign"):
    """Hold these vehicles, as far as grants name them, besides those held already."""

    posts: dict[Name, Post]
    grant_s: Seconds
    station_id: SystemId
    """The system id to speak with on the links."""
    axis_azimuth_rad: float
    reference: Reference
    gap_s: Seconds
    """Older bearings are stale."""


class _Order(_Message, frozen=True):
    """For one vehicle, by whoever has the token. Numbered: what has come before is not done again."""

    vehicle: Name
    token: Token
    order: Count


class BringUp(_Order, frozen=True, tag="bring_up"):
    """Bring it into guided flight, and stream to it from then on. Answered with Done."""


class Adopt(_Order, frozen=True, tag="adopt"):
    """Stream to it as it flies; not in its guided mode, or `withheld`, it is its pilot's. Answered with Done."""

    withheld: bool = False


class Release(_Order, frozen=True, tag="release"):
    """The operator gives it back to the service after its pilot had it. Answered with Done."""


class FlyLeg(_Order, frozen=True, tag="leg"):
    """Fly a leg, unless it was told to stop since `stops`. Told of with LegNotes."""

    stops: Count
    settings: RelaySettings
    made: SetUp | None = None
    """The stop monitor; None: that of the leg before..."""
    since: list[MonitorNote] = []
    """...which has been told this since; times are from when it was made."""


class Command(_Order, frozen=True, tag="command"):
    """Send a frame to it: commands and questions, never a setpoint."""

    frame: Frame
    urgent: bool = False


Order = Assign | BringUp | Adopt | Release | FlyLeg | Command


# --- reports of a node


class Telemetry(_Message, frozen=True, tag="telemetry"):
    """Frames of vehicles' autopilots, as they came."""

    frames: dict[Name, list[Frame]]


class Done(_Message, frozen=True, tag="done"):
    """An order was carried out, or why not and the way out; `state` is that of its stream then."""

    vehicle: Name
    token: Token
    order: Count
    state: StreamState | None = None
    problem: str = ""
    way_out: str = ""


class LegEnd(_Message, frozen=True):
    """How a leg ended: at its stop condition, or why it had to hold."""

    arrived: bool
    reason: str
    state: StreamState
    stop_angle_error_rad: float | None = None


class LegNotes(_Message, frozen=True, tag="leg"):
    """What the stop monitor of a leg was told and answered since the `first` note; numbered from 0 in each leg.

    Note times are s since the monitor was made.
    """

    vehicle: Name
    token: Token
    order: Count
    first: Count
    notes: list[MonitorNote]
    reason: str = ""
    """Why it is slowed."""
    ended: LegEnd | None = None


class Refused(_Message, frozen=True, tag="refused"):
    """An order was not carried out, by an older or unknown token or for its state."""

    vehicle: Name
    token: Token
    order: Count
    why: str


Report = Telemetry | Done | LegNotes | Refused


_ENCODER: Final = msgspec.json.Encoder()
_BEAT: Final = msgspec.json.Decoder(Beat, strict=True)
_GRANT: Final = msgspec.json.Decoder(Grant, strict=True)
_ORDER: Final[msgspec.json.Decoder[Order]] = msgspec.json.Decoder(Order, strict=True)
_REPORT: Final[msgspec.json.Decoder[Report]] = msgspec.json.Decoder(Report, strict=True)


def encode(message: Beat | Grant | Order | Report) -> bytes:
    """Return the JSON of a message."""
    return _ENCODER.encode(message)


def decode_beat(payload: bytes) -> Beat:
    """Return the beat a payload holds; msgspec.MsgspecError says which field is wrong and how."""
    return _BEAT.decode(payload)


def decode_grant(payload: bytes) -> Grant:
    """Return the grant a payload holds; msgspec.MsgspecError says which field is wrong and how."""
    return _GRANT.decode(payload)


def decode_order(payload: bytes) -> Order:
    """Return the order a payload holds; msgspec.MsgspecError says which field is wrong and how."""
    return _ORDER.decode(payload)


def decode_report(payload: bytes) -> Report:
    """Return the report a payload holds; msgspec.MsgspecError says which field is wrong and how."""
    return _REPORT.decode(payload)


def node_json_schemas(ref_template: str = "#/$defs/{name}") -> dict[str, Any]:
    """Return the JSON Schema of every message between the service and its nodes, and of its parts, by name."""
    return msgspec.json.schema_components((Beat, Grant, Order, Report), ref_template=ref_template)[1]
