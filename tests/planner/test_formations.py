"""Formations: where their slots are, and that a relay can take them up."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from planner.errors import ProblemError
from planner.formations import FORMATIONS, circle, custom, echelon, grid, line, polygon, transformed, vee
from planner.methods import joint
from planner.relay import RelayProblem


@pytest.mark.parametrize("name", FORMATIONS)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_every_formation_has_as_many_different_slots_as_asked(name, count):
    slots = FORMATIONS[name](count, 30.0)
    assert list(slots) == [f"O{k}" for k in range(1, count + 1)]
    assert len(set(slots.values())) == count
    assert all(cmath.isfinite(point) and abs(point) > 1.0 and abs(point - 30.0) > 1e-6 for point in slots.values())


@pytest.mark.parametrize("name", FORMATIONS)
def test_nonsense_is_refused(name):
    for count, size_m in ((0, 10.0), (3, 0.0), (3, -1.0), (3, math.inf), (3, math.nan)):
        with pytest.raises(ProblemError):
            FORMATIONS[name](count, size_m)


@pytest.mark.parametrize("name", FORMATIONS)
def test_every_formation_can_be_taken_up(name, check_plan):
    size_m = 100.0 if name in ("circle", "polygon") else 25.0
    slots = FORMATIONS[name](7, size_m)
    rng = np.random.default_rng(8)
    apart = [0j, 100 + 0j]
    while len(apart) < 9:
        point = complex(rng.uniform(-120, 120), rng.uniform(-120, 120))
        if min(abs(point - other) for other in [*apart, *slots.values()]) > 12.0:
            apart.append(point)
    receivers = {f"U{k}": point for k, point in enumerate(apart[2:], start=1)}
    problem = RelayProblem({"L0": 0j, "L1": 100 + 0j}, receivers, slots)
    check_plan(problem, joint.plan(problem))


def test_shapes():
    assert list(line(2, 10.0, 0.0).values()) == pytest.approx([10, 20])
    assert line(1, 10.0)["O1"] == pytest.approx(10j)
    assert echelon(1, math.sqrt(2.0))["O1"] == pytest.approx(-1 + 1j)
    assert list(vee(4, math.sqrt(2.0)).values()) == pytest.approx([-1 + 1j, -1 - 1j, -2 + 2j, -2 - 2j])
    assert list(grid(5, 10.0).values()) == pytest.approx([10j, 10 + 10j, 20 + 10j, 20j, 10 + 20j])
    assert list(grid(3, 10.0, columns=1).values()) == pytest.approx([10j, 20j, 30j])
    assert list(polygon(3, 10.0, sides=4).values()) == pytest.approx([10j, -10, -10j])
    assert list(polygon(2, 10.0, sides=3).values()) == pytest.approx(
        [10 * cmath.exp(2j * math.pi / 3), 10 * cmath.exp(4j * math.pi / 3)]
    )
    with pytest.raises(ProblemError, match="column"):
        grid(3, 10.0, columns=0)
    with pytest.raises(ProblemError, match="three sides"):
        polygon(3, 10.0, sides=2)


def test_custom_points_are_kept_in_order():
    assert list(custom({"b": 1j, "a": 2 + 0j}).items()) == [("b", 1j), ("a", 2 + 0j)]
    with pytest.raises(ProblemError, match="at least one"):
        custom({})
    with pytest.raises(ProblemError, match="finite"):
        custom({"a": complex(math.nan, 0.0)})


def test_a_formation_is_mirrored_rotated_and_scaled():
    slots = transformed(circle(3, 10.0), scale=2.0, rotation_rad=math.pi / 2, mirrored=True)
    assert list(slots.values()) == pytest.approx([20, -20j, -20])
    with pytest.raises(ProblemError, match="scaled"):
        transformed(slots, scale=0.0)
