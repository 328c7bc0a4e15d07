"""What the service says of a run for screens: its setup once, its state again and again, and its events.

JSON as the other messages, with a published schema. Places are x and y in the formation frame, m; angles in rad, the
subtended ones counter-clockwise seen from above. A field that is not there is not known. Readers pass over fields they
do not know, so that screens of another version keep working.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec

from drivers.bus.messages import LARGEST, Name, UnixNs
from drivers.strict_json import ESCAPES, malformed

Place = tuple[float, float]
"""x and y, formation frame, m."""
Count = Annotated[int, msgspec.Meta(ge=0, le=LARGEST)]
Level = Literal["info", "warning", "alert"]
"""`warning`: look at it; `alert`: something does not fly, or must not."""

ENDED_PHASES: Final = frozenset({"formed", "completed", "aborted", "failed"})
EVENTS_KEPT: Final = 2_000
"""So many of the latest events can be asked for."""


# --- once: what the run is about


class LegSetup(msgspec.Struct, frozen=True):
    """One leg as planned. It ends where the subtended angle of the stop reference reaches the stop angle."""

    guide: Name
    direction: Literal["towards", "away"]
    stop_reference: tuple[Name, Name]
    stop_angle_rad: float
    start_m: Place
    end_m: Place


class RouteSetup(msgspec.Struct, frozen=True):
    """How a receiver gets to its slot as planned, and when: s since the relay began."""

    receiver: Name
    slot: Name
    wave: int
    model: str
    start_m: Place
    slot_m: Place
    legs: list[LegSetup]
    begins_s: float
    ends_s: float


class TransmitterSetup(msgspec.Struct, frozen=True):
    """A transmitter from the start and its place. A beacon stands on the ground."""

    name: Name
    at_m: Place
    beacon: bool


class RunSetup(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the run is about. `run` names it: another one has another setup, and events of its own.

    A run that is planned anew gets another setup with the next `number`.

    North is `axis_azimuth_rad` counter-clockwise of the x axis: an azimuth a points along the polar direction
    axis_azimuth_rad - a.
    """

    run: str
    playbook: Name
    started_ns: UnixNs
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    axis_azimuth_rad: float
    slots: dict[Name, Place]
    transmitters: list[TransmitterSetup]
    routes: list[RouteSetup]
    fence: list[Place]
    min_separation_m: float
    speed_mps: float
    flight_altitude_m: float
    predicted_s: float
    """How long the relay takes as planned."""
    number: Count = 0
    attended: bool = False
    folder: str = ""
    """The run folder, as the service's machine has it."""


# --- again and again: how it goes


class Alert(msgspec.Struct, frozen=True):
    """What is wrong, with whom, and what to do about it; `way_out` may be empty."""

    level: Level
    subject: str
    text: str
    way_out: str


class LegState(msgspec.Struct, frozen=True, omit_defaults=True):
    """The leg being flown: from where the receiver was located, and what is known of it from angles alone."""

    number: int
    guide: Name
    direction: Literal["towards", "away"]
    stop_reference: tuple[Name, Name]
    stop_angle_rad: float
    start_m: Place
    end_m: Place
    band_rad: float
    """So much off the stop angle the leg may end..."""
    band_m: float
    """...and so many metres off its end."""
    angle_rad: float | None = None
    """As measured last."""
    rate_radps: float | None = None
    remaining_m: float | None = None
    cross_track_m: float | None = None
    """Positive to the left."""
    progress_mps: float | None = None
    sigma_m: float | None = None
    to_go_s: float | None = None


class BearingState(msgspec.Struct, frozen=True, omit_defaults=True):
    """The bearing reports of one receiver: the latest accepted one, and what became of all."""

    received: Count = 0
    dropped: dict[str, Count] = {}
    """How many were dropped, by what was wrong with them."""
    age_s: float | None = None
    """Since the latest accepted one was captured."""
    sigma_rad: float | None = None
    """The worst standard deviation in it."""
    heard: list[Name] = []


class ReceiverStatus(msgspec.Struct, frozen=True, omit_defaults=True):
    """One receiver in the relay."""

    name: Name
    slot: Name
    wave: int
    state: str
    since_s: float
    """When it came into this state, s since the run began."""
    reason: str = ""
    bearings: BearingState = BearingState()
    leg: LegState | None = None
    legs: int = 0
    """How many its route has."""
    to_go_s: float | None = None
    """Until it stands in its slot; 0 when it does, not known of one that does not fly on."""
    place_m: Place | None = None
    """Where bearings put it last..."""
    place_sigma_m: float | None = None
    """...and one standard deviation of that along the worst axis."""


class VehicleState(msgspec.Struct, frozen=True, omit_defaults=True):
    """One vehicle as its own telemetry tells it."""

    name: Name
    system_id: int
    transmits: bool = False
    """Whether it is on the air."""
    pilot: bool = False
    """Whether somebody else has it: it is left alone until it is released."""
    at_m: Place | None = None
    height_m: float | None = None
    """Above its home."""
    velocity_mps: Place | None = None
    """Along x and y."""
    heading_rad: float | None = None
    """Polar, as its nose points."""
    mode: str = ""
    armed: bool = False
    battery_percent: int | None = None
    battery_v: float | None = None
    estimator: Literal["good", "poor", "unknown"] = "unknown"
    silent_s: float | None = None
    """Since anything was heard of it; nothing yet when it is not there."""
    nearest: Name | None = None
    nearest_m: float | None = None


class LinkHealth(msgspec.Struct, frozen=True, omit_defaults=True):
    """One link, with the vehicles behind it. The loss is of the last ten seconds, 0 to 1."""

    vehicles: str
    address: str
    state: Literal["connecting", "up", "silent", "down"]
    received: Count
    sent: Count
    lost: Count
    refused: Count
    dropped: Count
    loss: float | None = None
    silent_s: float | None = None


class BusHealth(msgspec.Struct, frozen=True, omit_defaults=True):
    """The bus as the service sees it; `strangers` are reports of nobody in this run."""

    connected: bool
    strangers: Count = 0


class RecordingHealth(msgspec.Struct, frozen=True, omit_defaults=True):
    """Whether everything is written down; `problem` is empty while it is."""

    problem: str = ""
    dropped: Count = 0


class Histogram(msgspec.Struct, frozen=True):
    """How many values were at most each bound; the last count is of all."""

    bounds_s: list[float]
    counts: list[Count]
    sum_s: float


class RunState(msgspec.Struct, frozen=True, omit_defaults=True):
    """The run at one moment. The latest counts; `number` grows with each."""

    run: str
    number: Count
    time_ns: UnixNs
    """By the run's own clock..."""
    sent_ns: UnixNs
    """...and by the machine's, which differs from it in a simulation that runs fast."""
    phase: str
    """What it is at; at last one of ENDED_PHASES."""
    elapsed_s: float
    """Since the run began, by its own clock."""
    setup: Count = 0
    """The number of the RunSetup in force."""
    alerts: list[Alert] = []
    held: str | None = None
    """Why the relay holds, when it does."""
    waiting: bool = False
    """Whether it waits for the operator's word..."""
    ways_out: list[str] = []
    """...and the commands that would change something."""
    asked: str | None = None
    """What the run asks the operator, when it does: resume goes on, abort ends it."""
    to_go_s: float | None = None
    """Until every receiver stands in its slot, as planned from here on."""
    on_air: list[Name] = []
    taken: list[Name] = []
    """Whoever is its pilot's, and not the service's to fly."""
    receivers: list[ReceiverStatus] = []
    vehicles: list[VehicleState] = []
    links: list[LinkHealth] = []
    bus: BusHealth = BusHealth(connected=True)
    recording: RecordingHealth = RecordingHealth()
    decisions: Histogram | None = None
    """From the capture of a bearing to what the stop monitor decided on it."""
    events: Count = 0
    """How many there have been."""


# --- whenever something happens


class RunEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """Something that happened; numbered from 0 within its run."""

    run: str
    number: Count
    time_ns: UnixNs
    elapsed_s: float
    text: str
    level: Level = "info"
    vehicle: Name | None = None
    leg: int | None = None
    state: str | None = None
    """The state that a receiver came into."""


class EventsRequest(msgspec.Struct, frozen=True, omit_defaults=True):
    """Asks for the events from a number on."""

    first: Count = 0


class Events(msgspec.Struct, frozen=True):
    """Events in order: all that are kept, from the number asked for on."""

    events: list[RunEvent]


class ProvenRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A ControlRequest of somebody who holds the token for commanding; `proof` shows that, and not the token."""

    verb: Literal["hold", "resume", "skip", "release", "abort", "takeover"]
    said_ns: UnixNs
    proof: Annotated[str, msgspec.Meta(min_length=1, max_length=128)]
    vehicle: Name | None = None


RunMessage = TypeVar("RunMessage", bound=msgspec.Struct)

_DECODERS: Final[dict[type[msgspec.Struct], msgspec.json.Decoder[Any]]] = {
    kind: msgspec.json.Decoder(kind, strict=True)
    for kind in (RunSetup, RunState, RunEvent, EventsRequest, Events, ProvenRequest)
}
KINDS: Final = tuple(_DECODERS)
"""Every message about a run."""


def decode_run(payload: bytes, kind: type[RunMessage]) -> RunMessage:
    """Return the message a payload holds; MalformedMessageError says which field is wrong and how."""
    try:
        message: RunMessage = _DECODERS[kind].decode(payload)
    except ESCAPES as error:
        raise malformed(error) from None
    return message


def run_json_schemas(ref_template: str = "#/$defs/{name}") -> dict[str, Any]:
    """Return the JSON Schema of every message about a run and of its parts, by name."""
    return msgspec.json.schema_components(KINDS, ref_template=ref_template)[1]
