"""The `sensor` section of a playbook: the AOA sensors, and what is wrong with the simulated ones."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from drivers.aoa.model import MULTIPATH_JUMPS_RAD, ClockFault, Episodes, SensorFaults, SensorModel
from gcs.playbook.sections import Degrees, Metres, Name, Section

EVERYONE = "*"
"""Stands for every receiver that has no value of its own."""


def _read_by_receiver(value: Any) -> Any:
    if isinstance(value, dict):
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {EVERYONE: value}
    raise ValueError("is one number for all receivers, or {U1: ..., U2: ...}, where '*' stands for all others")


def _read_jump(value: Any) -> Any:
    return [value, value] if isinstance(value, int | float) and not isinstance(value, bool) else value


Share = Annotated[float, Field(ge=0.0, le=1.0)]
SmallAngle = Annotated[float, Field(ge=-180.0, le=180.0)]
Seconds = Annotated[float, Field(ge=-1e6, le=1e6)]
Size = Annotated[float, Field(ge=0.0, le=180.0)]
FromTo = Annotated[list[Size], Field(min_length=2, max_length=2)]
Jump = Annotated[FromTo, BeforeValidator(_read_jump, json_schema_input_type=Size | FromTo)]
AngleByReceiver = Annotated[
    dict[str, SmallAngle],
    BeforeValidator(_read_by_receiver, json_schema_input_type=SmallAngle | dict[str, SmallAngle]),
]
SecondsByReceiver = Annotated[
    dict[str, Seconds], BeforeValidator(_read_by_receiver, json_schema_input_type=Seconds | dict[str, Seconds])
]


class EpisodesSection(Section):
    """Something that comes and goes: `every_s` apart on average (null: never), for `for_s`."""

    every_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    for_s: Annotated[float, Field(gt=0.0, le=1e4)] = 2.0

    @property
    def episodes(self) -> Episodes | None:
        """The episodes, or None for never."""
        return None if self.every_s is None else Episodes(self.every_s, self.for_s)


class FaultsSection(Section):
    """What is wrong with the simulated sensors; nothing, unless it is asked for."""

    bias_deg: AngleByReceiver = Field(default_factory=dict)
    """Array mounting or compass: turns every bearing of a receiver, clockwise."""
    transmitter_bias_deg: dict[Name, SmallAngle] = Field(default_factory=dict)
    transmitter_sigma_deg: dict[Name, Annotated[float, Field(ge=0.0, le=20.0)]] = Field(default_factory=dict)
    """Noise of those transmitters' bearings, instead of `sigma_deg`."""
    outlier_share: Share = 0.0
    """Of bearings thrown to either side by one of the jumps: a number, or [from, to]."""
    outlier_jumps_deg: Annotated[list[Jump], Field(min_length=1)] = Field(
        default_factory=lambda: [[round(math.degrees(end_rad), 9) for end_rad in ends] for ends in MULTIPATH_JUMPS_RAD]
    )
    bearing_drop_out: Share = 0.0
    """Of single bearings lost; `drop_out` loses whole reports."""
    gaps: EpisodesSection = EpisodesSection()
    """No report at all."""
    stuck: EpisodesSection = EpisodesSection()
    """Report after report with the same bearings."""
    latency_jitter_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Up to this much is added to the latency of each report."""
    clock_offset_s: SecondsByReceiver = Field(default_factory=dict)
    """How far ahead a UAV's clock is; it gains the drift, and is set forward by the step after a while."""
    clock_drift_ppm: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    clock_step_s: Seconds = 0.0
    clock_step_after_s: Annotated[float, Field(ge=0.0, le=1e6)] = 30.0
    facing_deg: Degrees = 0.0
    """What the array faces, clockwise from the nose."""
    mirrored_share: Share = 0.0
    """Of bearings with front taken for back, as a linear array does."""
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 360.0
    """Centred on what the array faces."""
    range_m: Metres | None = None

    def of(self, receiver: str) -> SensorFaults:
        """Return what is wrong with the sensor of one receiver."""
        return SensorFaults(
            bias_rad=math.radians(_own(self.bias_deg, receiver)),
            transmitter_bias_rad={name: math.radians(deg) for name, deg in self.transmitter_bias_deg.items()},
            transmitter_sigma_rad={name: math.radians(deg) for name, deg in self.transmitter_sigma_deg.items()},
            outlier_share=self.outlier_share,
            outlier_jumps_rad=tuple((math.radians(low), math.radians(high)) for low, high in self.outlier_jumps_deg),
            bearing_drop_out=self.bearing_drop_out,
            gaps=self.gaps.episodes,
            stuck=self.stuck.episodes,
            latency_jitter_s=self.latency_jitter_s,
            clock=ClockFault(
                _own(self.clock_offset_s, receiver), self.clock_drift_ppm, self.clock_step_s, self.clock_step_after_s
            ),
            facing_rad=math.radians(self.facing_deg),
            mirrored_share=self.mirrored_share,
            field_of_view_rad=math.radians(self.field_of_view_deg),
            range_m=self.range_m,
        )


class SensorSection(Section):
    """The AOA sensors: their noise (one standard deviation), and how the simulated ones behave.

    `simulated` null: simulated exactly when the playbook names no vehicles. `rate_hz`, `latency_s`, `drop_out` and
    `faults` are the simulated sensors'; real ones are as they are.
    """

    reference: Literal["true_north", "body"] = "true_north"
    sigma_deg: Annotated[float, Field(ge=0.0, le=20.0)] = 0.1
    rate_hz: Annotated[float, Field(ge=2.0, le=50.0)] = 10.0
    latency_s: Annotated[float, Field(ge=0.0, le=0.4)] = 0.1
    drop_out: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    resolution_deg: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """The step that bearings are rounded to, as a KrakenSDR's are to 1; 0: to none."""
    simulated: bool | None = None
    faults: FaultsSection = FaultsSection()

    def is_simulated(self, *, vehicles_named: bool) -> bool:
        """Return whether this run simulates the sensors."""
        return not vehicles_named if self.simulated is None else self.simulated

    def model_of(self, receiver: str) -> SensorModel:
        """Return the simulated sensor of one receiver."""
        return SensorModel(
            sigma_rad=math.radians(self.sigma_deg),
            rate_hz=self.rate_hz,
            latency_s=self.latency_s,
            drop_out=self.drop_out,
            reference=self.reference,
            faults=self.faults.of(receiver),
            resolution_rad=math.radians(self.resolution_deg),
        )

    def strangers(self, receivers: Collection[str], transmitters: Collection[str]) -> list[str]:
        """Return what names in `faults` are no receivers, or nobody who ever transmits: 'key: name' each."""
        faults, receiving = self.faults, {EVERYONE, *receivers}
        known = {
            "bias_deg": (faults.bias_deg, receiving),
            "clock_offset_s": (faults.clock_offset_s, receiving),
            "transmitter_bias_deg": (faults.transmitter_bias_deg, {*receivers, *transmitters}),
            "transmitter_sigma_deg": (faults.transmitter_sigma_deg, {*receivers, *transmitters}),
        }
        return [f"{key}: {name}" for key, (named, allowed) in known.items() for name in sorted(named.keys() - allowed)]


def _own(values: dict[str, float], receiver: str) -> float:
    return values.get(receiver, values.get(EVERYONE, 0.0))
