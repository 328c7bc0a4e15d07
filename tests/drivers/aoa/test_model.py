"""The simulated sensor: as noisy, lossy and wrong as it was told to be, in exactly the way it was told."""

import cmath
import itertools
import math
import random
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aoa.model import (
    MULTIPATH_JUMPS_RAD,
    ClockFault,
    Episodes,
    SensorFaults,
    SensorModel,
    SimulatedSensor,
)
from drivers.bus.messages import LEAST_SIGMA_RAD

SIGMA_RAD = math.radians(0.5)
UNIX_NS = 1_800_000_000_000_000_000
TWO = {"L0": 80 + 0j, "L1": 0 + 60j}
TENTH_NS = 100_000_000


def sensor(*, sigma_rad=SIGMA_RAD, drop_out=0.0, seed="1/U1", reference="true_north", latency_s=0.1, **faults):
    model = SensorModel(
        sigma_rad, drop_out=drop_out, reference=reference, latency_s=latency_s, faults=SensorFaults(**faults)
    )
    return SimulatedSensor(model, random.Random(seed))


def measured(measuring, count, places=TWO, heading_rad=0.0, step_ns=TENTH_NS):
    """Return the reports of `count` instants at 10 Hz, None where there is none."""
    return [measuring.measure(UNIX_NS + k * step_ns, 0j, places, heading_rad) for k in range(count)]


def azimuths(report):
    return {bearing.transmitter: bearing.azimuth_rad for bearing in report.bearings}


def azimuth_error_rad(azimuth_rad, true_rad):
    return math.remainder(azimuth_rad - true_rad, math.tau)


def errors_of(reports, true_rad):
    return [azimuth_error_rad(report.bearings[0].azimuth_rad, true_rad) for report in reports]


@pytest.mark.parametrize("true_deg", [0.0, 90.0, 180.0, 270.0, 37.0])
def test_the_noise_has_the_sigma_it_claims_and_no_bias_also_where_the_circle_closes(true_deg):
    measuring, count = sensor(), 4000
    place = cmath.rect(80.0, math.radians(true_deg))
    reports = [measuring.measure(number, 3 + 4j, {"L0": 3 + 4j + place}) for number in range(count)]
    errors = errors_of(reports, math.radians(true_deg))
    assert abs(statistics.fmean(errors)) < 4 * SIGMA_RAD / math.sqrt(count)
    assert statistics.pstdev(errors) == pytest.approx(SIGMA_RAD, rel=4 / math.sqrt(2 * count))
    share_within_sigma = sum(abs(error) < SIGMA_RAD for error in errors) / count
    assert share_within_sigma == pytest.approx(0.6827, abs=0.03)
    assert {report.bearings[0].sigma_rad for report in reports} == {SIGMA_RAD}
    assert all(0.0 <= report.bearings[0].azimuth_rad <= math.tau for report in reports)


def test_the_noise_of_successive_reports_and_of_two_transmitters_is_independent():
    measuring, count = sensor(), 4000
    reports = [measuring.measure(number, 0j, {"L0": 10 + 0j, "L1": 10j}) for number in range(count)]
    first = errors_of(reports, 0.0)
    second = [azimuth_error_rad(report.bearings[1].azimuth_rad, math.pi / 2) for report in reports]
    assert abs(statistics.correlation(first[:-1], first[1:])) < 4 / math.sqrt(count)
    assert abs(statistics.correlation(first, second)) < 4 / math.sqrt(count)


def test_the_same_seed_measures_the_same_and_another_does_not():
    def measured(seed):
        measuring = sensor(seed=seed, drop_out=0.3)
        return [measuring.measure(number, 1j, {"L0": 10 + 0j}) for number in range(50)]

    assert measured("1/U1") == measured("1/U1")
    assert measured("1/U1") != measured("1/U2")
    assert measured("1/U1") != measured("2/U1")


def test_a_sensor_without_noise_is_exact_and_still_claims_no_perfection():
    report = sensor(sigma_rad=0.0).measure(77, 10 + 10j, {"L0": 0j})
    (bearing,) = report.bearings
    assert bearing.azimuth_rad == pytest.approx(math.radians(225))
    assert bearing.sigma_rad == LEAST_SIGMA_RAD
    assert (report.captured_ns, report.reference) == (77, "true_north")


def test_the_share_of_reports_that_drop_out_is_the_one_asked_for_and_leaves_gaps_in_the_sequence():
    measuring, count = sensor(drop_out=0.3), 5000
    reports = [measuring.measure(number, 0j, {"L0": 1 + 0j}) for number in range(count)]
    kept = [report for report in reports if report is not None]
    assert len(kept) / count == pytest.approx(0.7, abs=4 * math.sqrt(0.3 * 0.7 / count))
    assert [report.sequence for report in kept] == [report.captured_ns + 1 for report in kept]


def test_everything_drops_out_at_one_and_nothing_at_zero():
    assert all(sensor(drop_out=1.0).measure(0, 0j, {"L0": 1j}) is None for _ in range(50))
    lossless = sensor(drop_out=0.0)
    assert all(lossless.measure(0, 0j, {"L0": 1j}) is not None for _ in range(50))


def test_where_nothing_transmits_there_is_no_report():
    assert sensor().measure(0, 0j, {}) is None


# What is wrong with a sensor, one by one


def test_noise_is_drawn_as_it_always_was():
    """Seeds of earlier runs keep their meaning: one draw for the report, then one for each bearing."""
    draws = random.Random("1/U1")
    for report in measured(sensor(drop_out=0.2), 50):
        if draws.random() < 0.2:
            assert report is None
            continue
        for bearing in report.bearings:
            true_rad = cmath.phase(TWO[bearing.transmitter])
            assert bearing.azimuth_rad == (true_rad + draws.gauss(0.0, SIGMA_RAD)) % math.tau


@pytest.mark.parametrize("reference", ["true_north", "body"])
def test_bearings_are_rounded_noise_and_all_and_that_is_admitted(reference):
    step_rad = math.radians(1.0)
    whole = SimulatedSensor(SensorModel(SIGMA_RAD, reference=reference, resolution_rad=step_rad), random.Random("1/U1"))
    for fine, coarse in zip(measured(sensor(reference=reference), 50), measured(whole, 50), strict=True):
        assert (fine.resolution_rad, coarse.resolution_rad) == (0.0, step_rad)
        for name, azimuth_rad in azimuths(coarse).items():
            steps = azimuth_rad / step_rad
            assert steps == pytest.approx(round(steps), abs=1e-9)
            assert abs(azimuth_error_rad(azimuth_rad, azimuths(fine)[name])) <= step_rad / 2.0 + 1e-9


@pytest.mark.parametrize(
    "fault",
    [
        {"outlier_share": 0.3},
        {"bearing_drop_out": 0.3},
        {"gaps": Episodes(5.0, 2.0)},
        {"stuck": Episodes(5.0, 2.0)},
        {"mirrored_share": 0.3},
        {"latency_jitter_s": 0.3},
        {"clock": ClockFault(3600.0, 100.0)},
        {"range_m": 70.0},
        {"field_of_view_rad": math.pi / 2},
    ],
    ids=lambda fault: next(iter(fault)),
)
def test_a_fault_leaves_the_noise_of_what_it_does_not_hit_as_it_was(fault):
    plain, faulty = sensor(), sensor(**fault)
    same = changed = 0
    for good, bad in zip(measured(plain, 300), measured(faulty, 300), strict=True):
        plain.delay_s(), faulty.delay_s()
        for name, azimuth_rad in azimuths(good).items():
            kept = bad is not None and azimuths(bad).get(name) == azimuth_rad
            same, changed = same + kept, changed + (not kept)
    assert same >= 150
    assert changed > 0 or "latency_jitter_s" in fault or "clock" in fault


@pytest.mark.parametrize(
    ("other", "least_same"),
    [
        ({"bearing_drop_out": 0.3}, 1.0),
        ({"range_m": 70.0}, 1.0),
        ({"gaps": Episodes(2.0, 2.0)}, 1.0),
        ({"mirrored_share": 0.2}, 0.7),
    ],
)
def test_which_bearings_jump_does_not_depend_on_other_faults(other, least_same):
    alone, both = (measured(sensor(outlier_share=0.3, **faults), 300) for faults in ({}, other))
    pairs = [(azimuths(a)[n], z) for a, b in zip(alone, both, strict=True) if b for n, z in azimuths(b).items()]
    assert least_same * len(pairs) <= sum(a == b for a, b in pairs)
    assert len(pairs) < 600 or "mirrored_share" in other


def test_biases_turn_the_bearings_clockwise_and_are_not_admitted():
    biased = sensor(sigma_rad=0.0, bias_rad=0.1, transmitter_bias_rad={"L1": -0.03})
    (report,) = measured(biased, 1)
    assert azimuths(report) == pytest.approx({"L0": 0.1, "L1": math.pi / 2 + 0.07})
    assert {bearing.sigma_rad for bearing in report.bearings} == {LEAST_SIGMA_RAD}


def test_a_transmitter_may_be_noisier_than_the_others_and_is_known_to_be():
    reports = measured(sensor(transmitter_sigma_rad={"L1": 4 * SIGMA_RAD}), 4000)
    for name, sigma_rad in (("L0", SIGMA_RAD), ("L1", 4 * SIGMA_RAD)):
        errors = [azimuth_error_rad(azimuths(report)[name], cmath.phase(TWO[name])) for report in reports]
        assert statistics.pstdev(errors) == pytest.approx(sigma_rad, rel=0.05)
        assert {b.sigma_rad for report in reports for b in report.bearings if b.transmitter == name} == {sigma_rad}


def test_the_share_of_outliers_and_their_jumps_are_those_asked_for():
    reports = measured(sensor(sigma_rad=0.0, outlier_share=0.3), 4000, {"L0": 80 + 0j})
    errors = errors_of(reports, 0.0)
    jumps = [math.degrees(error) for error in errors if error != 0.0]
    assert len(jumps) / len(errors) == pytest.approx(0.3, abs=0.03)
    for low, high in ((9.0, 12.0), (45.0, 45.0), (180.0, 180.0)):
        kind = [jump for jump in jumps if low - 1e-9 <= abs(jump) <= high + 1e-9]
        assert len(kind) / len(jumps) == pytest.approx(1 / 3, abs=0.05)
        if low < 180.0:
            assert sum(jump > 0 for jump in kind) / len(kind) == pytest.approx(0.5, abs=0.08)
    assert sum(9.0 <= abs(jump) <= 181.0 for jump in jumps) == len(jumps)
    assert len(MULTIPATH_JUMPS_RAD) == 3


def test_single_bearings_drop_out_and_a_report_without_any_is_none():
    reports = measured(sensor(bearing_drop_out=0.4), 4000)
    kept = sum(len(report.bearings) for report in reports if report)
    assert kept / 8000 == pytest.approx(0.6, abs=0.03)
    assert sum(report is None for report in reports) / 4000 == pytest.approx(0.16, abs=0.03)
    assert measured(sensor(bearing_drop_out=1.0), 20) == [None] * 20


def runs(flags):
    """Return the lengths of the runs of True."""
    return [len(list(run)) for flag, run in itertools.groupby(flags) if flag]


def test_gaps_come_as_often_and_last_as_long_as_asked_for_whatever_the_rate():
    missing = [report is None for report in measured(sensor(gaps=Episodes(8.0, 2.0)), 40_000)]
    lengths = runs(missing)
    assert len(lengths) == pytest.approx(400, rel=0.15)
    assert min(lengths[:-1]) >= 20  # the last may be cut short, and two may touch
    assert statistics.median(lengths) == 20
    twice = [report is None for report in measured(sensor(gaps=Episodes(8.0, 2.0)), 80_000, step_ns=TENTH_NS // 2)]
    assert twice[::2] == missing


def test_a_stuck_sensor_repeats_its_last_bearings_under_new_times():
    reports = measured(sensor(stuck=Episodes(8.0, 3.0)), 20_000)
    repeated = [later.bearings == earlier.bearings for earlier, later in itertools.pairwise(reports)]
    assert statistics.median(runs(repeated)) == 30
    assert sum(repeated) / len(repeated) == pytest.approx(3 / 11, abs=0.05)
    assert [report.sequence for report in reports] == list(range(1, 20_001))
    assert all(later.captured_ns > earlier.captured_ns for earlier, later in itertools.pairwise(reports))


def test_the_latency_is_what_it_is_and_up_to_the_jitter_more():
    steady, jittery = sensor(latency_s=0.1), sensor(latency_s=0.1, latency_jitter_s=0.2)
    assert {steady.delay_s() for _ in range(20)} == {0.1}
    delays = [jittery.delay_s() for _ in range(4000)]
    assert min(delays) >= 0.1
    assert max(delays) <= 0.3
    assert statistics.fmean(delays) == pytest.approx(0.2, abs=0.01)


def test_reports_carry_the_time_of_a_clock_that_is_off_drifts_and_is_set():
    clock = ClockFault(offset_s=-7.5, drift_ppm=100.0, step_s=2.0, step_after_s=60.0)
    off = sensor(clock=clock)
    reports = measured(off, 1000)
    ahead_s = [(report.captured_ns - UNIX_NS - k * TENTH_NS) * 1e-9 for k, report in enumerate(reports)]
    assert ahead_s[0] == pytest.approx(-7.5)
    assert ahead_s[599] == pytest.approx(-7.5 + 59.9 * 1e-4, abs=1e-6)
    assert ahead_s[600] == pytest.approx(-5.5 + 60.0 * 1e-4, abs=1e-6)
    assert off.clock_ns(UNIX_NS + 900 * TENTH_NS) == reports[900].captured_ns


def test_a_linear_array_takes_front_for_back():
    """10 degrees to the right of what it faces is 10 degrees to the right of what is behind it, and the reverse."""
    heading_rad, facing_rad = math.radians(100), math.radians(90)
    place = {"L0": cmath.rect(50.0, heading_rad + facing_rad + math.radians(10))}
    (report,) = measured(sensor(sigma_rad=0.0, mirrored_share=1.0, facing_rad=facing_rad), 1, place, heading_rad)
    assert math.degrees(azimuths(report)["L0"]) == pytest.approx(100 + 90 + 170 - 360)
    shares = measured(sensor(sigma_rad=0.0, mirrored_share=0.25), 2000, {"L0": 50 + 0j})
    assert sum(azimuths(report)["L0"] > 1.0 for report in shares) / 2000 == pytest.approx(0.25, abs=0.04)


@pytest.mark.parametrize("heading_deg", [0.0, 135.0, -60.0])
def test_beyond_its_range_and_outside_its_field_of_view_nothing_is_heard(heading_deg):
    heading_rad = math.radians(heading_deg)
    places = {
        name: cmath.rect(distance_m, heading_rad + math.radians(aside_deg))
        for name, distance_m, aside_deg in (
            ("ahead", 50.0, 0.0),
            ("left", 50.0, -59.0),
            ("beside", 50.0, 61.0),
            ("behind", 50.0, 180.0),
            ("far", 101.0, 0.0),
        )
    }
    limited = sensor(field_of_view_rad=math.radians(120), range_m=100.0)
    assert azimuths(measured(limited, 1, places, heading_rad)[0]).keys() == {"ahead", "left"}
    assert measured(limited, 1, {"behind": places["behind"]}, heading_rad) == [None]
    turned = sensor(field_of_view_rad=math.radians(120), range_m=100.0, facing_rad=math.pi)
    assert azimuths(measured(turned, 1, places, heading_rad)[0]).keys() == {"behind"}


@given(st.floats(-math.pi, math.pi), st.sampled_from([{}, {"outlier_share": 0.5}, {"bias_rad": 0.2}]))
def test_bearings_from_the_body_are_those_from_north_less_the_heading(heading_rad, faults):
    north = measured(sensor(**faults), 10, TWO, heading_rad)
    body = measured(sensor(reference="body", **faults), 10, TWO, heading_rad)
    for from_north, from_nose in zip(north, body, strict=True):
        assert (from_north.reference, from_nose.reference) == ("true_north", "body")
        for name, azimuth_rad in azimuths(from_nose).items():
            assert azimuth_error_rad(azimuth_rad + heading_rad, azimuths(from_north)[name]) == pytest.approx(
                0.0, abs=1e-9
            )


@given(
    st.builds(
        SensorFaults,
        bias_rad=st.floats(-7.0, 7.0),
        outlier_share=st.floats(0.0, 1.0),
        bearing_drop_out=st.floats(0.0, 1.0),
        mirrored_share=st.floats(0.0, 1.0),
        facing_rad=st.floats(-7.0, 7.0),
        field_of_view_rad=st.floats(0.1, math.tau),
        stuck=st.none() | st.just(Episodes(1.0, 1.0)),
        gaps=st.none() | st.just(Episodes(1.0, 1.0)),
    ),
    st.floats(-7.0, 7.0),
)
def test_whatever_is_wrong_azimuths_stay_on_the_circle_and_runs_repeat(faults, heading_rad):
    def once():
        model = SensorModel(SIGMA_RAD, drop_out=0.1, faults=faults)
        return measured(SimulatedSensor(model, random.Random("3/U7")), 30, TWO, heading_rad)

    reports = once()
    assert reports == once()
    assert all(0.0 <= azimuth <= math.tau for report in reports if report for azimuth in azimuths(report).values())
