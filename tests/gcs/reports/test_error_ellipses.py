"""The error ellipses of a plan: where they are, how large, how they are turned."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from gcs.paper.chain import TRANSMITTERS, problem
from gcs.paper.printed import PRINTED
from gcs.reports.error_ellipses import ellipses_of, magnification
from gcs.reports.figure import draw_plan
from planner.methods import METHODS
from planner.plan import RelayPlan, Route
from planner.relay_accuracy import PlacementAccuracy, relay_accuracy

TURN = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])


def _ids(path: Path) -> list[str]:
    return [element.attrib["id"] for element in ET.parse(path).iter() if "id" in element.attrib]


@pytest.fixture(scope="module", params=["joint", "paper"])
def planned(request):
    relay = problem(PRINTED.table_3, 5.0)
    plan = METHODS[request.param](relay)
    return plan, relay_accuracy(relay, plan.routes)


def test_turning_points_and_slots_have_one_ellipse_each(planned, tmp_path):
    plan, accuracy = planned
    draw_plan(plan, TRANSMITTERS, tmp_path / "plan.svg", accuracy=accuracy)
    expected = [f"ellipse-slot-{route.slot}" for route in plan.routes]
    expected += [f"ellipse-turning-1-{route.receiver}" for route in plan.routes if len(route.legs) == 2]
    assert sorted(gid for gid in _ids(tmp_path / "plan.svg") if gid.startswith("ellipse")) == sorted(expected)
    assert "<!-- 3-sigma error" in (tmp_path / "plan.svg").read_text()


def test_the_wave_of_every_receiver_is_written_in_its_start(planned, tmp_path):
    plan, _ = planned
    draw_plan(plan, TRANSMITTERS, tmp_path / "plan.svg")
    waves = sorted(gid for gid in _ids(tmp_path / "plan.svg") if gid.startswith("wave-"))
    assert waves == sorted(f"wave-{route.wave}-{route.receiver}" for route in plan.routes)


def test_without_accuracy_there_is_none(planned, tmp_path):
    draw_plan(planned[0], TRANSMITTERS, tmp_path / "plan.svg")
    assert not any(gid.startswith("ellipse") for gid in _ids(tmp_path / "plan.svg"))
    assert "3-sigma" not in (tmp_path / "plan.svg").read_text()


def _one(covariance: np.ndarray, slot: complex = 3 + 4j) -> tuple[RelayPlan, dict[str, PlacementAccuracy]]:
    route = Route("U1", "O1", 1, 1, "I", 0j, slot, ())
    plan = RelayPlan("paper", (route,), 1.0, 1.0, 1.0)
    return plan, {"U1": PlacementAccuracy((), covariance, 1.0, None)}


def test_semi_axes_are_three_sigma_along_the_principal_axes():
    (ellipse,) = ellipses_of(*_one(TURN @ np.diag([4.0, 0.25]) @ TURN.T))
    assert ellipse.at == 3 + 4j
    assert ellipse.semi_axes_m == pytest.approx((6.0, 1.5))
    assert math.tan(ellipse.turned_rad) == pytest.approx(math.tan(0.5))


def test_an_exact_placement_has_no_ellipse():
    assert ellipses_of(*_one(np.zeros((2, 2)))) == []


def test_a_singular_covariance_is_a_flat_ellipse():
    (ellipse,) = ellipses_of(*_one(np.array([[1.0, 1.0], [1.0, 1.0]])))
    assert ellipse.semi_axes_m == pytest.approx((3.0 * math.sqrt(2.0), 0.0), abs=1e-6)


def test_receivers_without_a_prediction_are_left_out():
    plan, accuracy = _one(np.eye(2))
    both = replace(plan, routes=(*plan.routes, replace(plan.routes[0], receiver="U2", slot="O2")))
    assert [ellipse.gid for ellipse in ellipses_of(both, accuracy)] == ["ellipse-slot-O1"]


@pytest.mark.parametrize(("sigma_m", "factor"), [(1.0, 2), (1.5, 1), (0.15, 10), (0.018, 100), (1e-6, 1000), (50.0, 1)])
def test_small_ellipses_are_magnified_and_large_ones_never_shrunk(sigma_m, factor):
    ellipses = ellipses_of(*_one(np.eye(2) * sigma_m**2))
    assert magnification(ellipses, side_m=200.0) == factor


def test_the_legend_says_how_much_larger_they_are_drawn(tmp_path):
    plan, accuracy = _one(np.eye(2) * 0.04**2, slot=200j)
    draw_plan(plan, TRANSMITTERS, tmp_path / "plan.svg", accuracy=accuracy)
    assert "<!-- 3-sigma error (50 times true size) -->" in (tmp_path / "plan.svg").read_text()
