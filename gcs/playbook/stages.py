"""The `stages` of a playbook: what is done one after another. A stage is one class here, and a line of `StageEntry`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, StringConstraints, model_serializer, model_validator

from gcs.expectations import Expectations
from gcs.playbook.sections import Degrees, Name, Section

BareWord = Literal[
    "connect", "preflight", "arm", "takeoff", "locate", "plan", "relay", "measure", "return", "land"
]  # fmt: skip
"""The stages that need no settings."""
OnFailure = Literal["hold", "skip", "return", "land", "abort"]
Duration = Annotated[float, Field(gt=0.0, le=86_400.0)]
Delay = Annotated[float, Field(ge=0.0, le=86_400.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Turn = Annotated[float, Field(ge=-180.0, le=180.0)]
Fault = Literal[
    "pilot",
    "sensor_silent",
    "sensor_stuck",
    "sensor_bias",
    "sensor_jump",
    "clock_step",
    "clock_drift",
    "report_faults",
    "transmitter_silent",
    "transmitter_drift",
    "telemetry_lost",
    "link_cut",
    "link_faults",
    "freeze",
    "reboot",
    "battery_low",
    "router_killed",
    "router_frozen",
    "service_frozen",
    "service_killed",
    "disk_full",
]
RelayState = Literal["LOCATING", "LEG_1", "LEG_2", "VERIFYING", "TRIMMING", "PLACED", "HELD", "PILOT", "FAILED"]


class Stage(Section):
    """What every stage may say.

    A stage that takes longer than `timeout_s` has failed. When one fails, every vehicle holds first, and then:
    `hold` waits for the operator where one attends, and else ends the run with all hovering; `skip` goes on with the
    next stage; `return` and `land` bring everybody down and end the run; `abort` ends it at once.
    """

    name: Name | None = None
    timeout_s: Duration | None = None
    on_failure: OnFailure = "hold"
    expect: Expectations = Field(default_factory=dict)


class RetriedStage(Stage):
    """A stage that may be tried again, for it moves nothing."""

    retries: Annotated[int, Field(ge=0, le=10)] = 0


class Connect(RetriedStage):
    """Hear every vehicle."""


class Preflight(RetriedStage):
    """Check every vehicle; nothing is armed."""


class Arm(Stage):
    """Arm every vehicle on the ground, each once. An autopilot disarms itself when `takeoff` does not follow soon."""


class Takeoff(Stage):
    """Bring every vehicle into guided flight at `flight.altitude_m`, armed first where it is not."""


class Locate(RetriedStage):
    """Locate every receiver from bearings, before the relay."""


class Plan(Stage):
    """Plan the relay from where the receivers were located, or else from their starts."""


class Relay(Stage):
    """Bring the receivers to their slots."""


class Hold(Stage):
    """Let every vehicle hold its place for a time."""

    for_s: Duration


class Measure(Stage):
    """Take for a time how far the receivers hover from their slots, into the report."""

    for_s: Duration = 10.0
    every_s: Annotated[float, Field(ge=0.05, le=60.0)] = 0.2


class Return(Stage):
    """Let every vehicle fly home by its own return mode and land, one after another."""


class Land(Stage):
    """Land every vehicle where it is, all at once."""


class Wait(Stage):
    """Let time pass; nothing is said to the vehicles."""

    for_s: Duration


class Prompt(Stage):
    """Ask the operator to go on; without one attending it fails."""

    text: Annotated[str, StringConstraints(min_length=1, max_length=500)]


class EmissionStage(Stage):
    """Switch transmitters on, or no longer keep them on: what the relay needs is on in any case."""

    on: list[Name] = Field(default_factory=list)
    off: list[Name] = Field(default_factory=list)


class When(Section):
    """A moment of the relay: so long after a receiver entered a state."""

    receiver: Name
    state: RelayState
    after_s: Delay = 0.0


class Inject(Stage):
    """Arm a fault of the simulation: it strikes `after_s` from now, or at a moment of the relay; the run goes on.

    Most are for ever, or end after `for_s`; where drawn by lot, then from the playbook's `seed`.

    Of a UAV. `pilot`: a pilot's station takes `vehicle` out of guided flight. `link_cut`, `telemetry_lost`: nothing
    gets through any more, or nothing that it says. `link_faults`: its radio loses, repeats and delays packets, either
    way, and lets some overtake others. `freeze`: its whole process stands still. `reboot`: its autopilot starts anew.
    `battery_low`: it tells of an empty battery. `transmitter_drift`: another station flies it off, in its guided mode.

    Of a receiver's sensor. `sensor_silent`: it reports nothing. `sensor_stuck`: it reports the same again and again.
    `sensor_bias`, `sensor_jump`: its bearings, or those `of` one transmitter, are off by an angle. `clock_step`,
    `clock_drift`: its clock is set, or goes wrong. `report_faults`: what `link_faults` are to packets, to its reports.

    Of a transmitter, be it a beacon. `transmitter_silent`: no sensor hears it any more.

    Of none. `router_killed`: the bus has gone, with `for_s` until its router is started anew. `router_frozen`: it
    stands still. `service_frozen`: this service does, and `service_killed` ends it, and with it what it simulates.
    `disk_full`: nothing that this service writes gets into any file.
    """

    fault: Fault
    vehicle: Name | None = None
    at: When | None = None
    after_s: Delay | None = None
    for_s: Duration | None = None
    loss: Share = 0.0
    """Of packets, of `link_faults`, or reports, of `report_faults`; the following, too."""
    duplication: Share = 0.0
    reordering: Share = 0.0
    delay_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    jitter_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """At most so much is added to the delay of each."""
    bias_deg: Turn = 0.0
    """Clockwise, of `sensor_bias`."""
    jump_deg: Turn = 0.0
    """Clockwise, of `sensor_jump`."""
    of: Name | None = None
    """The only transmitter whose bearings are off."""
    step_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.0
    """By which `clock_step` sets the clock forward."""
    drift_ppm: Annotated[float, Field(ge=-1e5, le=1e5)] = 0.0
    """Which the clock gains, of `clock_drift`."""
    speed_mps: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Of `transmitter_drift`, and its course."""
    course_deg: Degrees = 0.0


AnyStage = (
    Connect | Preflight | Arm | Takeoff | Locate | Plan | Relay | Hold | Measure | Return | Land | Wait | Prompt
    | EmissionStage | Inject
)  # fmt: skip


class StageEntry(Section):
    """One stage, under the word that it is."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    connect: Connect | None = None
    preflight: Preflight | None = None
    arm: Arm | None = None
    takeoff: Takeoff | None = None
    locate: Locate | None = None
    plan: Plan | None = None
    relay: Relay | None = None
    hold: Hold | None = None
    measure: Measure | None = None
    return_: Return | None = Field(default=None, alias="return")
    land: Land | None = None
    wait: Wait | None = None
    prompt: Prompt | None = None
    emission: EmissionStage | None = None
    inject: Inject | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_word(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {value: {}}
        if not isinstance(value, dict) or len(value) != 1:
            raise ValueError(
                "a stage is one word, or one word with its settings, as {relay: {timeout_s: 300}}; "
                f"the words are {', '.join(name.rstrip('_') for name in cls.model_fields)}"
            )
        return {word: {} if settings is None else settings for word, settings in value.items()}

    @model_serializer
    def _written(self) -> dict[str, Any]:
        return {self.kind: self.stage.model_dump(mode="json")}

    @property
    def kind(self) -> str:
        """The word."""
        (name,) = self.model_fields_set
        return name.rstrip("_")

    @property
    def stage(self) -> AnyStage:
        """The stage."""
        (name,) = self.model_fields_set
        stage: AnyStage = getattr(self, name)
        return stage


StageItem = Annotated[StageEntry, BeforeValidator(lambda value: value, json_schema_input_type=StageEntry | BareWord)]
