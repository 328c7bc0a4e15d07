"""Geometry at its limits: one leg, no leg, parallel lines, transmitters in line, and what must come out."""

from __future__ import annotations

import cmath
import json
import math

import numpy as np
import pytest

from planner.errors import InfeasiblePlanError, ProblemError
from planner.methods import joint
from planner.plan import plan_to_json
from planner.relay import RelayProblem
from planner.routes import Verdict, general_routes, half_angle_tangents, model_1, model_2, two_leg_routes


def one(transmitters, start, slot, **options):
    names = {f"T{k}": complex(place) for k, place in enumerate(transmitters)}
    return RelayProblem(names, {"U": complex(start)}, {"O": complex(slot)}, **{"min_separation_m": 0.0} | options)


def test_a_guide_on_the_line_to_the_slot_gives_one_leg(check_plan):
    for guide in (-50 + 0j, 110 + 0j):
        problem = one([guide, 30 + 80j], 0j, 60 + 0j)
        plan = joint.plan(problem)
        check_plan(problem, plan)
        assert len(plan.routes[0].legs) == 1
        assert plan.total_length_m == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("guides", "turning_point"), [((-50 + 0j, 30 + 80j), 60 + 0j), ((30 + 80j, -50 + 0j), 0j)], ids=["first", "second"]
)
def test_a_guide_on_the_line_to_the_slot_makes_one_leg_nothing(guides, turning_point):
    routes = general_routes(0j, 60 + 0j, *guides)
    assert routes.feasible
    assert complex(routes.turning_point) == pytest.approx(turning_point)
    assert routes.length_m == pytest.approx(60.0)


def test_both_guides_on_the_line_are_rejected_by_themselves():
    assert two_leg_routes(0j, 60 + 0j, -50 + 0j, 110 + 0j).verdict == Verdict.PARALLEL
    with pytest.raises(InfeasiblePlanError, match="parallel"):
        joint.plan(one([-50 + 0j, 110 + 0j], 0j, 60 + 0j))


@pytest.mark.parametrize("tilt_rad", [0.0, 1e-14, 1e-6, 1e-3])
def test_nearly_parallel_lines_are_rejected(tilt_rad):
    start, slot = 0j, 30 + 40j
    routes = general_routes(start, slot, 100 + 0j, slot + 100 * cmath.exp(1j * tilt_rad))
    assert routes.verdict == Verdict.PARALLEL
    assert np.isfinite(routes.length_m)


def test_a_slot_opposite_to_the_second_transmitter_needs_another_pair(check_plan):
    for guides in ((0j, 100 + 0j), (100 + 0j, 0j)):
        verdict = int(general_routes(30 + 60j, -100 + 0j, *guides).verdict)
        assert verdict in {Verdict.AT_TRANSMITTER, Verdict.TOO_CLOSE}, "it turns at L0, or passes it"
    with pytest.raises(InfeasiblePlanError, match="U -> O: blocked"):
        joint.plan(one([0j, 100 + 0j], 30 + 60j, -100 + 0j, min_separation_m=5.0))
    problem = one([0j, 100 + 0j, 0 - 100j], 30 + 60j, -100 + 0j, min_separation_m=5.0)
    check_plan(problem, joint.plan(problem))


def test_opposite_slots_with_l0_between_are_served_by_other_pairs(check_plan):
    problem = RelayProblem(
        {"L0": 0j, "L1": 100 + 0j},
        {"U1": 20 + 70j, "U2": -70 + 10j, "U3": 10 - 60j},
        {"O1": 100j, "O2": -100 + 0j, "O3": -100j},
    )
    plan = joint.plan(problem)
    check_plan(problem, plan)


def test_receiver_1_of_table_4_cannot_use_the_first_two_transmitters(twenty):
    problem = twenty()
    start, slot = problem.receivers["U1"], problem.slots["O1"]
    for guides in ((0j, 100 + 0j), (100 + 0j, 0j)):
        assert general_routes(start, slot, *guides, min_separation_m=5.0).verdict == Verdict.TOO_CLOSE
        assert general_routes(start, slot, *guides).verdict == Verdict.TOO_CLOSE, "through its own guide"
    with pytest.raises(InfeasiblePlanError):
        joint.plan(one([0j, 100 + 0j], start, slot, min_separation_m=5.0))


def test_equal_polar_angles_are_no_special_case():
    start, slot = 50 + 50j, 80 + 80j
    for model in (model_1, model_2):
        assert model(start, slot, 0j, 100 + 0j).length_m == pytest.approx(42.43, abs=0.005)
    assert joint.plan(one([0j, 100 + 0j], start, slot)).total_length_m == pytest.approx(42.43, abs=0.005)


def test_a_receiver_already_in_its_slot_does_not_move(check_plan):
    problem = one([0j, 100 + 0j], 40 + 30j, 40 + 30j)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert plan.routes[0].legs == ()
    assert plan.routes[0].predicted_3sigma_m == pytest.approx(3.0)
    for tangent in half_angle_tangents(40 + 30j, 40 + 30j, np.array([0j, 100 + 0j])):
        assert np.isfinite(tangent).all()
    for objective in ("makespan", "emission", "balanced"):
        assert joint.plan(one([0j, 100 + 0j], 40 + 30j, 40 + 30j, objective=objective)).total_length_m == 0.0


def test_a_slot_at_a_transmitter_stays_free_of_a_receiver_that_is_there(check_plan):
    with pytest.raises(InfeasiblePlanError):
        joint.plan(one([0j, 100 + 0j], 0j, 0j))
    with pytest.raises(InfeasiblePlanError):
        joint.plan(one([0j, 100 + 0j], 3 + 0j, 3 + 0j, min_separation_m=5.0))


@pytest.mark.parametrize("heading_referenced", [False, True])
def test_a_start_or_slot_at_a_transmitter_is_refused(heading_referenced):
    for start, slot in ((100 + 0j, 50 + 50j), (50 + 50j, 100 + 0j)):
        with pytest.raises(InfeasiblePlanError):
            joint.plan(one([0j, 100 + 0j], start, slot, heading_referenced=heading_referenced))


def test_a_path_exactly_at_the_separation_is_accepted():
    obstacle = {"mast": 30 - 5j}
    problem = one([-50 + 0j, 30 + 80j], 0j, 60 + 0j, min_separation_m=5.0, obstacles=obstacle)
    assert joint.plan(problem).total_length_m == pytest.approx(60.0)
    rounded = one([-50 + 0j, 30 + 80j], 0j, 60 + 0j, min_separation_m=5.0 + 1e-10, obstacles=obstacle)
    assert joint.plan(rounded).total_length_m == pytest.approx(60.0)
    closer = one([-50 + 0j, 30 + 80j], 0j, 60 + 0j, min_separation_m=5.0 + 1e-6, obstacles=obstacle)
    with pytest.raises(InfeasiblePlanError, match="blocked"):
        joint.plan(closer)


def test_an_enclosed_slot_is_said_to_be_blocked():
    places = [complex(8 * column, 8 * row) for column in (-1, 0, 1) for row in (-1, 0, 1) if column or row]
    problem = one([-100 + 0j, 100 - 90j, 5 + 120j, *places], 60 + 50j, 0j, min_separation_m=5.0)
    with pytest.raises(InfeasiblePlanError, match="blocked") as caught:
        joint.plan(problem)
    assert "step aside" in str(caught.value)
    assert "third leg" in str(caught.value)


def test_a_noiseless_problem_is_planned(check_plan, eight):
    problem = eight(bearing_sigma_rad=0.0, start_sigma_m=0.0, tolerance_3sigma_m=0.001, map_trim=True)
    plan = joint.plan(problem)
    check_plan(problem, plan)
    assert max(route.predicted_3sigma_m for route in plan.routes) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [
        {"objective": "fame"},
        {"samples": 0},
        {"tolerance_3sigma_m": math.nan},
        {"max_leg_m": -1.0},
        {"fence": (0j, 1j)},
        {"fence": (0j, 1j, complex(math.nan, 0.0))},
        {"obstacles": {"mast": complex(math.inf, 0.0)}},
        {"ground_transmitters": frozenset({"nobody"})},
        {"bearing_sigma_rad": math.inf},
    ],
)
def test_nonsense_is_no_problem(wrong):
    with pytest.raises(ProblemError):
        one([0j, 100 + 0j], 40 + 30j, 50 + 50j, **wrong)


def test_without_slots_there_is_no_problem():
    with pytest.raises(ProblemError, match="slot"):
        RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U": 10j}, {})


def test_a_circle_of_a_kilometre_far_from_the_origin_is_finite(check_plan):
    shift = 1e6 + 1e6j
    problem = RelayProblem(
        {"L0": shift, "L1": shift + 1000},
        {"U1": shift + 300 + 500j, "U2": shift - 700 - 200j},
        {"O1": shift + 1000j, "O2": shift - 800 - 500j},
    )
    json.dumps(plan_to_json(joint.plan(problem)), allow_nan=False)
