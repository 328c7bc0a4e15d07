"""Locating by directions, heading known or not: exactness, covariance, outliers, and every refusal."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.errors import PositioningError
from planner.positioning import dilution, locate_by_bearings, locate_by_subtended_angles

L0, L1, L2 = 0j, 100 + 0j, 30 + 90j
FIELD = {"L0": L0, "L1": L1, "L2": L2, "L3": -60 - 70j, "L4": 110 + 85j, "L5": -95 + 20j}
RECEIVER = 45 + 30j
SIGMA_RAD = math.radians(0.5)
LOCATE = {True: locate_by_bearings, False: locate_by_subtended_angles}
HEADING_RAD = {True: 0.0, False: 2.2}

coordinates = st.floats(-150.0, 150.0)
points = st.builds(complex, coordinates, coordinates)
unhurried = settings(deadline=None)
heading_known = pytest.mark.parametrize("heading_referenced", [True, False])


def first(count: int) -> dict[str, complex]:
    return dict(list(FIELD.items())[:count])


def directions(receiver: complex, transmitters: dict[str, complex], heading_rad: float = 0.0) -> dict[str, float]:
    return {name: float(np.angle(place - receiver)) + heading_rad for name, place in transmitters.items()}


def placed(*points_xy: complex) -> dict[str, complex]:
    return {f"L{number}": point for number, point in enumerate(points_xy)}


@pytest.mark.parametrize("heading_referenced", [True, False])
@unhurried
@given(receiver=points, turn=st.floats(-7.0, 7.0))
def test_exact_directions_give_the_receiver_back(heading_referenced, receiver, turn):
    assume(dilution(receiver, list(FIELD.values()), heading_referenced) < 1e4)
    heading = 0.0 if heading_referenced else turn
    fix = LOCATE[heading_referenced](directions(receiver, FIELD, heading), FIELD, 1e-6)
    assert abs(fix.position - receiver) < 1e-7
    assert fix.residual_rad < 1e-9
    assert fix.used == tuple(FIELD)
    assert fix.rejected == ()


@pytest.mark.parametrize(("heading_referenced", "count"), [(True, 2), (True, 3), (False, 3), (False, 4)])
@unhurried
@given(receiver=points)
def test_the_fewest_transmitters_are_enough(heading_referenced, count, receiver):
    transmitters = first(count)
    assume(dilution(receiver, list(transmitters.values()), heading_referenced) < 1e3)
    assume(min(abs(receiver - place) for place in transmitters.values()) > 1.0)
    heading = HEADING_RAD[heading_referenced]
    fix = LOCATE[heading_referenced](directions(receiver, transmitters, heading), transmitters, 0.0)
    assert abs(fix.position - receiver) < 1e-7


@heading_known
@unhurried
@given(
    noise=st.lists(st.floats(-0.01, 0.01), min_size=6, max_size=6),
    turn=st.floats(-math.pi, math.pi),
    scale=st.floats(0.1, 10.0),
)
def test_rotation_mirror_and_scale_move_the_fix_along(heading_referenced, noise, turn, scale):
    locate, rotation = LOCATE[heading_referenced], cmath.rect(scale, turn)
    seen = {name: angle + off for (name, angle), off in zip(directions(RECEIVER, FIELD).items(), noise, strict=True)}
    fix = locate(seen, FIELD, SIGMA_RAD)
    turned = locate({k: v + turn for k, v in seen.items()}, {k: rotation * v for k, v in FIELD.items()}, SIGMA_RAD)
    mirrored = locate({k: -v for k, v in seen.items()}, {k: v.conjugate() for k, v in FIELD.items()}, SIGMA_RAD)
    assert abs(turned.position - rotation * fix.position) < 1e-6 * scale
    assert turned.covariance.trace() == pytest.approx(scale**2 * fix.covariance.trace(), rel=1e-6)
    assert abs(mirrored.position - fix.position.conjugate()) < 1e-6
    assert mirrored.covariance[0, 1] == pytest.approx(-fix.covariance[0, 1], rel=1e-6, abs=1e-9)


@unhurried
@given(turn=st.floats(-10.0, 10.0), noise=st.lists(st.floats(-0.01, 0.01), min_size=6, max_size=6))
def test_an_unknown_heading_changes_nothing(turn, noise):
    seen = {name: angle + off for (name, angle), off in zip(directions(RECEIVER, FIELD).items(), noise, strict=True)}
    fix = locate_by_subtended_angles(seen, FIELD, SIGMA_RAD)
    turned = locate_by_subtended_angles({name: angle + turn for name, angle in seen.items()}, FIELD, SIGMA_RAD)
    assert abs(turned.position - fix.position) < 1e-6


@heading_known
def test_the_order_of_the_transmitters_changes_nothing(heading_referenced):
    rng = np.random.default_rng(6)
    seen = {name: angle + SIGMA_RAD * rng.normal() for name, angle in directions(RECEIVER, FIELD).items()}
    forth = LOCATE[heading_referenced](seen, FIELD, SIGMA_RAD)
    back = LOCATE[heading_referenced](dict(reversed(seen.items())), FIELD, SIGMA_RAD)
    assert abs(back.position - forth.position) < 1e-6
    assert back.used == forth.used[::-1]


@heading_known
@pytest.mark.parametrize("count", [3, 6])
def test_the_covariance_is_what_monte_carlo_finds(heading_referenced, count):
    rng, transmitters = np.random.default_rng(5), first(count)
    exact = directions(RECEIVER, transmitters, HEADING_RAD[heading_referenced])
    sigmas = {
        name: SIGMA_RAD * factor for name, factor in zip(transmitters, (0.2, 0.1, 0.3, 0.2, 0.15, 0.4), strict=False)
    }
    errors = []
    for _ in range(1500):
        seen = {name: angle + sigmas[name] * rng.normal() for name, angle in exact.items()}
        error = LOCATE[heading_referenced](seen, transmitters, sigmas).position - RECEIVER
        errors.append((error.real, error.imag))
    found = np.cov(np.array(errors).T)
    predicted = LOCATE[heading_referenced](exact, transmitters, sigmas).covariance
    scale = np.sqrt(np.outer(predicted.diagonal(), predicted.diagonal()))
    assert np.abs((found - predicted) / scale).max() < 0.1
    assert np.abs(np.linalg.eigvalsh(found) / np.linalg.eigvalsh(predicted) - 1.0).max() < 0.1


@heading_known
def test_covariance_and_dilution_tell_the_same(heading_referenced):
    seen = directions(RECEIVER, FIELD, HEADING_RAD[heading_referenced])
    covariance = LOCATE[heading_referenced](seen, FIELD, SIGMA_RAD).covariance
    gdop = float(dilution(RECEIVER, list(FIELD.values()), heading_referenced))
    assert math.sqrt(covariance.trace()) == pytest.approx(gdop * SIGMA_RAD)


@pytest.mark.parametrize(("heading_referenced", "count"), [(True, 4), (True, 6), (False, 5), (False, 6)])
@pytest.mark.parametrize("off_deg", [-170.0, -12.0, 12.0, 90.0])
@pytest.mark.parametrize("liar", ["L0", "L2", "L3"])
def test_one_reflected_direction_is_rejected(heading_referenced, count, off_deg, liar):
    rng, transmitters = np.random.default_rng(2), first(count)
    exact = directions(RECEIVER, transmitters, HEADING_RAD[heading_referenced])
    seen = {name: angle + 0.2 * SIGMA_RAD * rng.normal() for name, angle in exact.items()}
    seen[liar] += math.radians(off_deg)
    fix = LOCATE[heading_referenced](seen, transmitters, 0.2 * SIGMA_RAD)
    assert fix.rejected == (liar,)
    assert set(fix.used) == set(transmitters) - {liar}
    assert abs(fix.position - RECEIVER) < 4.0 * math.sqrt(fix.covariance.trace())


@heading_known
def test_honest_noise_is_hardly_ever_rejected(heading_referenced):
    rng, rejected = np.random.default_rng(8), 0
    exact = directions(RECEIVER, FIELD, HEADING_RAD[heading_referenced])
    for _ in range(200):
        seen = {name: angle + SIGMA_RAD * rng.normal() for name, angle in exact.items()}
        rejected += len(LOCATE[heading_referenced](seen, FIELD, SIGMA_RAD).rejected)
    assert rejected <= 2


def test_two_reflections_among_six_are_rejected():
    seen = directions(RECEIVER, FIELD)
    seen["L1"] += 0.3
    seen["L4"] -= 0.2
    fix = locate_by_bearings(seen, FIELD, SIGMA_RAD)
    assert fix.rejected == ("L1", "L4")
    assert abs(fix.position - RECEIVER) < 1e-9


def test_two_ways_of_leaving_one_out_that_fit_as_well_are_refused():
    """L1 and L3 lie nearly opposite each other: L0 and L2 each tell another place on the line between them."""
    seen = directions(40 - 30j, first(4))
    seen["L0"] += math.radians(3.0)
    with pytest.raises(PositioningError, match=r"40-30j and 42\.\d+-28\.\d+j fit as well"):
        locate_by_bearings(seen, FIELD, math.radians(0.1))


def test_many_transmitters_are_seeded_by_a_sample_of_their_triples():
    ring = placed(*(cmath.rect(100.0 + 3 * k, 0.29 * k) for k in range(30)))
    seen = directions(RECEIVER, ring, 1.0)
    assert abs(locate_by_subtended_angles(seen, ring, SIGMA_RAD).position - RECEIVER) < 1e-9


@heading_known
def test_a_prior_is_one_more_seed_and_does_not_move_the_fix(heading_referenced):
    rng = np.random.default_rng(3)
    exact = directions(RECEIVER, FIELD, HEADING_RAD[heading_referenced])
    seen = {name: angle + SIGMA_RAD * rng.normal() for name, angle in exact.items()}
    alone = LOCATE[heading_referenced](seen, FIELD, SIGMA_RAD)
    for prior in (RECEIVER, -80 + 60j):
        assert abs(LOCATE[heading_referenced](seen, FIELD, SIGMA_RAD, prior=prior).position - alone.position) < 1e-6


@pytest.mark.parametrize(
    ("heading_referenced", "count", "message"),
    [
        (True, 0, "two transmitters, only none heard"),
        (True, 1, "two transmitters, only L0 heard: switch on another"),
        (False, 2, "three transmitters while the heading is unknown, only L0, L1 heard"),
    ],
)
def test_too_few_transmitters_are_refused(heading_referenced, count, message):
    with pytest.raises(PositioningError, match=message):
        LOCATE[heading_referenced](directions(RECEIVER, first(count)), FIELD, SIGMA_RAD)


def test_a_transmitter_at_no_known_place_is_refused():
    with pytest.raises(PositioningError, match="no place is known for transmitter L7"):
        locate_by_bearings({"L0": 0.0, "L7": 1.0}, FIELD, SIGMA_RAD)


@pytest.mark.parametrize(
    ("seen", "sigma_rad"),
    [
        ({"L0": math.nan, "L1": 0.0}, SIGMA_RAD),
        ({"L0": 1.0, "L1": 0.0}, -1.0),
        ({"L0": 1.0, "L1": 0.0}, math.inf),
        ({"L0": 1.0, "L1": 0.0}, {"L1": 0.1}),
    ],
)
def test_what_is_not_finite_is_refused(seen, sigma_rad):
    with pytest.raises(PositioningError, match="direction to L0"):
        locate_by_bearings(seen, FIELD, sigma_rad)


@pytest.mark.parametrize("receiver", [50 + 0j, 150 + 0j, -30 + 0j, 50 + 0.1j, 400 + 3j])
@pytest.mark.parametrize("prior", [None, 40 + 5j])
def test_lines_of_bearing_that_are_nearly_parallel_are_refused(receiver, prior):
    with pytest.raises(PositioningError, match=r"L0, L1 do not fix the receiver: .*parallel.*; use a transmitter off"):
        locate_by_bearings(directions(receiver, first(2)), FIELD, SIGMA_RAD, prior=prior)


def test_lines_of_bearing_that_cross_behind_the_receiver_are_refused():
    with pytest.raises(PositioningError, match=r"L0, L1 contradict each other: L. would lie behind"):
        locate_by_bearings({"L0": 1.0, "L1": 2.0}, FIELD, SIGMA_RAD)


def test_three_bearings_that_contradict_each_other_are_refused():
    seen = directions(RECEIVER, first(3))
    seen["L2"] += 0.4
    with pytest.raises(PositioningError, match=r"L0, L1, L2 contradict each other: 3 agree, to .* standard dev"):
        locate_by_bearings(seen, FIELD, SIGMA_RAD)


@pytest.mark.parametrize(("heading_referenced", "count"), [(True, 4), (False, 5)])
def test_directions_no_majority_agrees_on_are_refused(heading_referenced, count):
    seen = directions(RECEIVER, first(count))
    for name, off in zip(seen, (0.5, -0.4, 0.3, 0.7, -0.6), strict=False):
        seen[name] += off
    with pytest.raises(PositioningError, match="contradict each other"):
        LOCATE[heading_referenced](seen, FIELD, 1e-4)


@heading_known
@pytest.mark.parametrize("at", ["L0", "L1"])
def test_a_receiver_at_a_transmitter_is_refused(heading_referenced, at):
    with pytest.raises(PositioningError):
        LOCATE[heading_referenced](directions(FIELD[at], first(4)), FIELD, SIGMA_RAD)


def test_the_refusal_names_the_transmitter_the_receiver_stands_at():
    seen = directions(L1, first(3)) | {"L1": 0.3}
    with pytest.raises(PositioningError, match="stands at transmitter L1"):
        locate_by_bearings(seen, FIELD, SIGMA_RAD)


@pytest.mark.parametrize("sigma_rad", [0.0, 1e-4, SIGMA_RAD])
@pytest.mark.parametrize("count", [3, 4, 7])
@pytest.mark.parametrize("prior", [None, 80 - 50j])
def test_a_receiver_on_the_circle_of_all_transmitters_is_never_located(sigma_rad, count, prior):
    rng = np.random.default_rng(11)
    ring = placed(*(cmath.rect(100.0, math.tau * k / 9) for k in range(count)))
    for _ in range(6):
        seen = directions(cmath.rect(100.0, -0.7), ring, 1.0)
        seen = {name: angle + sigma_rad * rng.normal() for name, angle in seen.items()}
        with pytest.raises(PositioningError, match=r"circle|contradict"):
            locate_by_subtended_angles(seen, ring, sigma_rad, prior=prior)


@pytest.mark.parametrize("receiver", [-30 + 0j, 20 + 0j, 70 + 0j, 180 + 0j])
def test_a_receiver_on_the_line_of_collinear_transmitters_is_never_located(receiver):
    line = placed(0j, 50 + 0j, 100 + 0j)
    for locate in LOCATE.values():
        with pytest.raises(PositioningError, match="line"):
            locate(directions(receiver, line), line, SIGMA_RAD)


@pytest.mark.parametrize("receiver", [20 + 30j, 20 - 30j, 130 + 60j])
def test_a_receiver_off_the_line_of_collinear_transmitters_is_located(receiver):
    line = placed(0j, 50 + 0j, 100 + 0j)
    for locate in LOCATE.values():
        assert abs(locate(directions(receiver, line), line, 1e-4).position - receiver) < 1e-9


def test_nothing_but_a_finite_fix_or_a_refusal_comes_out_of_random_fields():
    rng = np.random.default_rng(4)
    refused = 0
    for _ in range(200):
        count = int(rng.integers(2, 8))
        at = rng.choice([1.0, 40.0, 100.0]) * np.round(rng.normal(size=count) + 1j * rng.normal(size=count), 1)
        receiver = complex(rng.choice(at)) if rng.random() < 0.1 else complex(*rng.uniform(-150, 150, 2))
        transmitters = placed(*at.tolist())
        sigma_rad = 10.0 ** rng.uniform(-5, -1)
        seen = {k: v + sigma_rad * rng.normal() for k, v in directions(receiver, transmitters).items()}
        if rng.random() < 0.3:
            seen["L1"] += rng.uniform(-3, 3)
        for locate in LOCATE.values():
            try:
                fix = locate(seen, transmitters, sigma_rad, prior=None if rng.random() < 0.5 else receiver + 3.0)
            except PositioningError:
                refused += 1
            else:
                assert cmath.isfinite(fix.position)
                assert np.isfinite(fix.covariance).all()
                assert (np.linalg.eigvalsh(fix.covariance) > 0.0).all()
                assert math.isfinite(fix.residual_rad)
    assert 0 < refused < 300
