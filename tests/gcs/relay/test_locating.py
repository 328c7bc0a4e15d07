"""Locating: enough transmitters are heard, wild reports do not count, and the ledger counts who was on the air."""

from __future__ import annotations

import asyncio
import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Emission, decode
from gcs.bearings import Observation, Observations
from gcs.relay.emission import EmissionControl
from gcs.relay.locating import hear, locate, transmitters_to_hear, typical_direction
from planner.errors import PositioningError
from tests.fakes import FakeBus, ManualClock

STANDING = {"L0": 0j, "L1": 100 + 0j, "U1": 50 + 90j}
EXACT = dict.fromkeys(STANDING, 0.0)


def test_what_the_route_needs_is_enough_where_it_fixes_the_place() -> None:
    assert transmitters_to_hear(40 + 60j, ["L0", "L1"], STANDING) == {"L0", "L1"}


def test_one_more_is_switched_on_where_two_lie_in_line_with_the_receiver() -> None:
    assert transmitters_to_hear(160 + 2j, ["L0", "L1"], STANDING) == {"L0", "L1", "U1"}


def test_a_receiver_that_needs_nobody_still_hears_two() -> None:
    assert len(transmitters_to_hear(40 + 60j, [], STANDING)) == 2


def test_when_nothing_helps_nothing_is_switched_on() -> None:
    in_line = {"L0": 0j, "L1": 100 + 0j, "U1": 200 + 0j}
    assert transmitters_to_hear(300 + 0j, ["L0", "L1"], in_line) == {"L0", "L1"}
    assert transmitters_to_hear(300 + 0j, ["L0", "L1"], {"L0": 0j, "L1": 100 + 0j}) == {"L0", "L1"}


def seen_from(place: complex, count: int = 10) -> list[Observation]:
    directions = {name: cmath.phase(at - place) for name, at in STANDING.items()}
    return [Observation(float(k), dict(directions), dict.fromkeys(STANDING, 0.002)) for k in range(count)]


async def test_hearing_ends_with_enough_of_each_or_when_most_reports_lack_one_or_none_comes() -> None:
    clock = ManualClock()
    observations = Observations(clock)
    for number in range(20):
        observations.push(Observation(float(number), {"L0": 1.0}, {"L0": 0.002}))
    assert [heard.captured_s for heard in await hear(observations, ["L0"], 5, 0.5)] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert len(await hear(observations, ["L0", "L1"], 2, 0.5)) == 8
    waiting = asyncio.create_task(hear(observations, ["L0"], 20, 0.5))
    await clock.advance(0.4)
    assert not waiting.done()
    await clock.advance(0.2)
    assert len(await waiting) == 7


def test_reports_together_give_the_place() -> None:
    fix = locate(seen_from(30 + 40j), STANDING, EXACT, 35 + 35j)
    assert fix.position == pytest.approx(30 + 40j, abs=1e-6)


def test_what_is_rounded_is_known_no_better_however_often_it_is_heard() -> None:
    place, step_rad = 30 + 40j, math.radians(1.0)
    for count in (10, 1000):
        fine = seen_from(place, count)
        rounded = [
            replace(
                one,
                directions_rad={name: round(at / step_rad) * step_rad for name, at in one.directions_rad.items()},
                resolution_rad=step_rad,
            )
            for one in fine
        ]
        fix = locate(rounded, STANDING, EXACT, place)
        assert 0.2 < math.sqrt(float(np.trace(fix.covariance))) < 0.6
        assert abs(fix.position - place) < 2.0 * math.sqrt(float(np.trace(fix.covariance)))
        assert np.trace(locate(fine, STANDING, EXACT, place).covariance) < 0.3 * np.trace(fix.covariance)


def test_rounded_directions_that_noise_spreads_all_count() -> None:
    step_rad = math.radians(1.0)
    directions = [0.0] * 6 + [step_rad] * 4
    assert typical_direction(directions, step_rad / math.sqrt(12.0)) == pytest.approx(0.4 * step_rad)


def test_wild_reports_do_not_count() -> None:
    observations = seen_from(30 + 40j)
    for observation in observations[:3]:
        observation.directions_rad["L0"] += math.radians(45.0)
    assert locate(observations, STANDING, EXACT, 30 + 40j).position == pytest.approx(30 + 40j, abs=1e-6)


@pytest.mark.parametrize("off_m", [0.3, 0.5])
def test_transmitters_that_sway_are_no_contradiction(off_m: float) -> None:
    """Half a metre at 10 m is 3 degrees, at a noise of 0.04: wind makes that. The fix is then known the less."""
    place = 45 + 50j
    swayed = STANDING | {"U1": STANDING["U1"] + off_m}
    calm, windy = (
        locate(
            [Observation(0.0, {n: cmath.phase(at - place) for n, at in seen.items()}, dict.fromkeys(seen, 0.002))] * 10,
            STANDING,
            EXACT,
            place,
        )
        for seen in (STANDING, swayed)
    )
    assert abs(calm.position - place) < 1e-6
    assert abs(windy.position - place) < off_m
    assert np.trace(windy.covariance) >= np.trace(calm.covariance)


def test_a_transmitter_that_stands_elsewhere_is_left_out_or_a_contradiction() -> None:
    place = 45 + 50j
    elsewhere = STANDING | {"U1": STANDING["U1"] + 20}
    directions = {name: cmath.phase(at - place) for name, at in elsewhere.items()}
    observations = [Observation(0.0, directions, dict.fromkeys(STANDING, 0.002))] * 10
    with pytest.raises(PositioningError):
        locate(observations, STANDING, EXACT, place)


def test_a_place_known_badly_counts_for_less() -> None:
    """U1 was placed to 0.3 m and stands 0.5 m off: the fix holds on to the others."""
    place = 45 + 50j
    off = STANDING | {"U1": STANDING["U1"] - 0.5}
    directions = {name: cmath.phase(at - place) for name, at in STANDING.items()}
    observations = [Observation(0.0, directions, dict.fromkeys(STANDING, 0.002))] * 10
    fix = locate(observations, off, EXACT | {"U1": 0.3}, place)
    assert abs(fix.position - place) < 0.1


def test_a_place_nothing_fixes_is_refused() -> None:
    with pytest.raises(PositioningError):
        locate(seen_from(300 + 0j), {"L0": 0j, "L1": 100 + 0j}, EXACT, 300 + 0j)


@given(st.floats(-3.2, 3.2), st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=30))
def test_the_typical_direction_lies_among_them_even_at_the_seam(about: float, offsets: list[float]) -> None:
    typical = typical_direction([cmath.phase(cmath.rect(1.0, about + offset)) for offset in offsets])
    off = cmath.phase(cmath.rect(1.0, typical - about))
    assert min(offsets) - 1e-9 <= off <= max(offsets) + 1e-9


@pytest.mark.parametrize("jump_deg", [10.0, 45.0, 180.0])
@pytest.mark.parametrize("wild", [0, 4])
def test_the_typical_direction_is_not_led_astray_by_a_jump(jump_deg: float, wild: int) -> None:
    directions = [0.001, -0.001, 0.002, 0.0, -0.002, 0.001, -0.001, 0.002]
    directions[wild] += math.radians(jump_deg)
    assert abs(typical_direction(directions)) < 0.002


def test_emission_is_the_union_of_needs_and_the_ledger_adds_up() -> None:
    clock, bus, keys = ManualClock(), FakeBus(), SwarmKeys("test")
    emission = EmissionControl(bus, keys, clock)
    emission.need("U1", ["L0", "L1"])
    clock.jump(10.0)
    emission.need("U2", ["L1", "U7"])
    clock.jump(10.0)
    emission.need("U1", [])
    assert emission.on_air == {"L1", "U7"}
    clock.jump(10.0)
    emission.need("U2", [])
    assert emission.on_air == frozenset()
    assert emission.transmitter_s() == pytest.approx(20 + 30 + 20)
    told = [(key.split("/")[3], decode(payload, Emission).on) for key, payload in bus.sent]
    assert told == [("L0", True), ("L1", True), ("U7", True), ("L0", False), ("L1", False), ("U7", False)]
    assert keys.emission("L0") in bus.reliable_keys
