"""What an earlier service flew of a run, and the report of all of it."""

from __future__ import annotations

import math

import msgspec
import pytest

from gcs.recording.series import LegBegun, LegEnded, Sample, Switched, Tick
from gcs.resume.earlier import earlier_of, with_earlier

S = 1_000_000_000


def leg(time_s: int, number: int) -> LegBegun:
    return LegBegun(time_s * S, "U1", number, "L0", "away", ("L0", "L1"), 1.0, (0.0, 0.0), (9.0, 0.0), 0.1)


def tick(time_s: int, state: str, x_m: float, nearest_m: float = 20.0) -> Tick:
    return Tick(time_s * S, {"U1": Sample(state, at_m=(x_m, 0.0), nearest_m=nearest_m)})


SERIES = [
    msgspec.json.encode(line)
    for line in (
        Switched(10 * S, "L0", on=True),
        tick(11, "LOCATING", 0.0),
        leg(12, 1),
        tick(12, "LEG_1", 0.5),
        tick(13, "LEG_1", 3.5, nearest_m=7.0),
        LegEnded(14 * S, "U1", 1, math.radians(0.5)),
        leg(14, 2),
        tick(15, "LEG_2", 5.5),
        Switched(16 * S, "L1", on=True),
        Switched(18 * S, "L0", on=False),
        tick(18, "VERIFYING", 5.6),
    )
]


def report(flown_m: float | None = None, separation_m: float | None = None) -> dict:
    flown = {"flown_length_m": flown_m, "stop_angle_error_deg": None, "duration_s": None}
    return {
        "flown_total_length_m": 100.0, "min_separation_m": separation_m, "emission_transmitter_s": 30.0,
        "receivers": [{"name": "U1", "legs": [{"planned_length_m": 4.0, **flown}, {"planned_length_m": 2.0, **flown}]}],
    }  # fmt: skip


def test_lengths_separation_and_emission_of_both_are_put_together() -> None:
    whole = with_earlier(report(separation_m=9.0), earlier_of(SERIES, 20 * S))
    assert whole["flown_total_length_m"] == pytest.approx(105.5)
    assert whole["min_separation_m"] == 7.0
    assert whole["emission_transmitter_s"] == pytest.approx(30.0 + 8.0 + 4.0), "L1 was on the air until now"


def test_the_legs_of_one_that_is_not_flown_again_are_those_flown_before() -> None:
    first, second = with_earlier(report(), earlier_of(SERIES, 20 * S))["receivers"][0]["legs"]
    assert first == {
        "planned_length_m": 4.0, "flown_length_m": pytest.approx(3.5), "stop_angle_error_deg": pytest.approx(0.5),
        "duration_s": pytest.approx(2.0),
    }  # fmt: skip
    assert (second["flown_length_m"], second["duration_s"]) == (pytest.approx(2.0), None)


def test_the_legs_of_one_that_has_flown_since_are_its_own() -> None:
    first, _ = with_earlier(report(flown_m=1.0), earlier_of(SERIES, 20 * S))["receivers"][0]["legs"]
    assert first["flown_length_m"] == 1.0


def test_one_that_was_located_anew_has_flown_only_what_came_after() -> None:
    again = [*SERIES, msgspec.json.encode(leg(30, 1)), msgspec.json.encode(tick(31, "LEG_1", 6.6))]
    first, second = with_earlier(report(), earlier_of(again, 40 * S))["receivers"][0]["legs"]
    assert (first["flown_length_m"], second["flown_length_m"]) == (pytest.approx(1.0), None)


@pytest.mark.parametrize("lines", [[], [b"\xff", b"{}", b'{"kind": "tick"'], [SERIES[5]]])
def test_a_series_that_tells_nothing_changes_nothing(lines: list[bytes]) -> None:
    assert with_earlier(report(separation_m=9.0), earlier_of(lines, 20 * S)) == report(separation_m=9.0)
