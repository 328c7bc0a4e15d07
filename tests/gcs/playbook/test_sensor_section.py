"""The sensor section: what it says reaches the simulated sensors in radians, and what is wrong is refused."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from drivers.aoa.model import ClockFault, Episodes, SensorFaults, SensorModel
from gcs.playbook.sensor_section import SensorSection


def section(**values: object) -> SensorSection:
    return SensorSection.model_validate(values)


def faults(receiver: str = "U1", **values: object) -> SensorFaults:
    return section(faults=values).model_of(receiver).faults


def test_without_faults_the_sensors_have_none() -> None:
    assert section().model_of("U1") == SensorModel(math.radians(0.1), 10.0, 0.1, 0.0, "true_north", SensorFaults())


def test_everything_reaches_the_model() -> None:
    made = section(
        reference="body",
        sigma_deg=0.5,
        rate_hz=20,
        latency_s=0.2,
        drop_out=0.1,
        resolution_deg=1,
        faults={
            "transmitter_bias_deg": {"L0": 1},
            "transmitter_sigma_deg": {"L1": 2.5},
            "outlier_share": 0.1,
            "outlier_jumps_deg": [[9, 12], 45, 180],
            "bearing_drop_out": 0.2,
            "gaps": {"every_s": 30},
            "stuck": {"every_s": 60, "for_s": 5},
            "latency_jitter_s": 0.1,
            "clock_drift_ppm": 50,
            "clock_step_s": -3,
            "clock_step_after_s": 12,
            "facing_deg": 90,
            "mirrored_share": 0.3,
            "field_of_view_deg": 120,
            "range_m": 500,
        },
    ).model_of("U1")
    assert made == SensorModel(
        math.radians(0.5),
        20.0,
        0.2,
        0.1,
        "body",
        SensorFaults(
            transmitter_bias_rad={"L0": math.radians(1)},
            transmitter_sigma_rad={"L1": math.radians(2.5)},
            outlier_share=0.1,
            bearing_drop_out=0.2,
            gaps=Episodes(30.0, 2.0),
            stuck=Episodes(60.0, 5.0),
            latency_jitter_s=0.1,
            clock=ClockFault(0.0, 50.0, -3.0, 12.0),
            facing_rad=math.radians(90),
            mirrored_share=0.3,
            field_of_view_rad=math.radians(120),
            range_m=500.0,
        ),
        math.radians(1),
    )


def test_a_number_is_for_all_receivers_and_a_mapping_for_each() -> None:
    assert faults("U7", bias_deg=2).bias_rad == math.radians(2)
    each: dict[str, float] = {"U1": 2, "*": -1}
    assert [faults(name, bias_deg=each).bias_rad for name in ("U1", "U7")] == [math.radians(2), math.radians(-1)]
    assert [faults(name, clock_offset_s={"U1": 3600}).clock.offset_s for name in ("U1", "U7")] == [3600.0, 0.0]


@pytest.mark.parametrize(
    "values",
    [
        {"sigma_deg": -1},
        {"simulated": "yes"},
        {"reference": "magnetic"},
        {"faults": {"bias_deg": "2"}},
        {"faults": {"bias_deg": True}},
        {"faults": {"bias_deg": [1, 2]}},
        {"faults": {"bias_deg": {"U1": 200}}},
        {"faults": {"bias_deg": math.nan}},
        {"faults": {"outlier_share": 1.1}},
        {"faults": {"outlier_jumps_deg": []}},
        {"faults": {"outlier_jumps_deg": [[1, 2, 3]]}},
        {"faults": {"outlier_jumps_deg": ["9"]}},
        {"faults": {"outlier_jumps_deg": [200]}},
        {"faults": {"gaps": {"every_s": 0}}},
        {"faults": {"gaps": {"sometimes": 1}}},
        {"faults": {"field_of_view_deg": 0}},
        {"faults": {"range_m": 0}},
        {"faults": {"no_such_fault": 1}},
    ],
)
def test_what_cannot_be_meant_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        section(**values)


@pytest.mark.parametrize(
    ("simulated", "vehicles_named", "expected"),
    [(None, False, True), (None, True, False), (True, True, True), (False, False, False)],
)
def test_sensors_are_simulated_with_the_vehicles_unless_said_otherwise(
    simulated: bool | None, vehicles_named: bool, expected: bool
) -> None:
    assert section(simulated=simulated).is_simulated(vehicles_named=vehicles_named) is expected


def test_names_nobody_has_are_found() -> None:
    wrong = section(
        faults={
            "bias_deg": {"U9": 1, "*": 0, "U1": 2},
            "clock_offset_s": {"L0": 1},
            "transmitter_bias_deg": {"L0": 1, "X": 2},
            "transmitter_sigma_deg": {"U1": 1},
        }
    )
    assert wrong.strangers(["U1", "U2"], ["L0", "L1"]) == [
        "bias_deg: U9",
        "clock_offset_s: L0",
        "transmitter_bias_deg: X",
    ]


def test_a_section_written_out_reads_the_same() -> None:
    made = section(faults={"bias_deg": 1, "outlier_jumps_deg": [[9, 12], 45], "gaps": {"every_s": 3}})
    assert SensorSection.model_validate(made.model_dump(mode="json")) == made


def test_the_schema_for_editors_knows_the_short_forms() -> None:
    properties = SensorSection.model_json_schema()["$defs"]["FaultsSection"]["properties"]
    for key in ("bias_deg", "clock_offset_s"):
        assert {option["type"] for option in properties[key]["anyOf"]} == {"number", "object"}
    assert {option["type"] for option in properties["outlier_jumps_deg"]["items"]["anyOf"]} == {"number", "array"}
