"""How fast planning is: ratios against a named peer in the same run, and growth with the number of UAVs.

Run `python tests/benchmarks/bench_planner.py [largest n]`.
"""

from __future__ import annotations

import cmath
import itertools
import math
import resource
import sys
import time
from collections.abc import Callable

import numpy as np

from planner.errors import InfeasiblePlanError, PlannerError
from planner.formations import circle
from planner.methods import joint, paper
from planner.relay import RelayProblem
from planner.routes import general_routes, two_step


def ring(count: int, seed: int = 0) -> RelayProblem:
    """Return receivers at random in a ring about a circle of slots."""
    radius_m = max(100.0, 5.0 * count)
    rng = np.random.default_rng(seed)
    apart = [0j, complex(radius_m)]
    while len(apart) < count + 2:
        point = cmath.rect(rng.uniform(0.4, 1.5) * radius_m, rng.uniform(0.0, math.tau))
        if np.abs(np.array(apart) - point).min() >= 10.0:
            apart.append(point)
    receivers = {f"U{k}": point for k, point in enumerate(apart[2:], start=1)}
    return RelayProblem({"L0": 0j, "L1": complex(radius_m)}, receivers, circle(count, radius_m))


def seconds(run: Callable[[], object], repeats: int = 3) -> float:
    """Return the least time of a few runs, s."""
    times: list[float] = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return min(times)


def loop_over_pairs(problem: RelayProblem) -> list[float]:
    """Return the paper's cost matrix pair by pair, in plain Python."""
    a, first_b = problem.transmitters.values()
    slots = list(problem.slots.values())
    lengths: list[float] = []
    for start in problem.receivers.values():
        for slot, b in zip(slots, [first_b, *slots[:-1]], strict=True):
            try:
                lengths.append(two_step(start, slot, a, b).length_m)
            except PlannerError:
                lengths.append(math.inf)
    return lengths


def compare_cost_matrices(count: int) -> None:
    problem = ring(count)
    vectorised_s = seconds(lambda: paper.cost_matrix(problem))
    loop_s = seconds(lambda: loop_over_pairs(problem), repeats=1)
    print(f"paper's cost matrix, n = {count}: {loop_s / vectorised_s:.0f}x a per-pair Python loop")


def compare_general_routes(count: int, transmitters: int) -> None:
    problem = ring(count)
    starts, slots = np.array(list(problem.receivers.values())), np.array(list(problem.slots.values()))
    guides = slots[:transmitters] * 1.1

    def loop() -> list[float]:
        return [
            float(general_routes(*one).length_m) for one in itertools.product(starts[:2], slots[:2], guides, guides)
        ]

    grid = (starts[:, None, None, None], slots[:, None, None], guides[:, None], guides)
    per_route_s = seconds(lambda: general_routes(*grid)) / (count**2 * transmitters**2)
    loop_s = seconds(loop, repeats=1) / (4 * transmitters**2)
    print(f"general routes, {count} x {count} x {transmitters}^2: {loop_s / per_route_s:.0f}x one route at a time")


def show_growth(counts: list[int]) -> None:
    first: tuple[float, float] | None = None
    for count in counts:
        problem = ring(count)
        try:
            paper_s = seconds(lambda problem=problem: paper.plan(problem), repeats=1)
        except InfeasiblePlanError:
            paper_s = seconds(lambda problem=problem: paper.cost_matrix(problem), repeats=1)
        begin = time.perf_counter()
        plan = joint.plan(problem)
        joint_s = time.perf_counter() - begin
        first = first or (paper_s, joint_s)
        peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        ratio = plan.total_length_m / plan.straight_line_bound_m
        print(
            f"n = {count:5d}: paper {paper_s:7.3f} s ({paper_s / first[0]:7.1f}x), joint {joint_s:7.3f} s "
            f"({joint_s / first[1]:6.1f}x), joint / straight {ratio:.7f}, peak {peak_gb:.2f} GB"
        )


if __name__ == "__main__":
    largest = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    compare_cost_matrices(min(200, largest))
    compare_general_routes(min(20, largest), 12)
    show_growth([n for n in (10, 20, 50, 100, 200, 500, 1000) if n <= largest])
