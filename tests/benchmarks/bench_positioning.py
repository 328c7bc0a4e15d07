"""Two-circle positioning against pygeodesy's pierlotx and scipy's least_squares, all in one run.

    python tests/benchmarks/bench_positioning.py [cases]

Every solver gets the same random receivers and transmitters, well conditioned and away from each other. Prints the
time per solve, the ratio to the batched closed form, and how far the solutions are apart; exits 1 when the closed form
and pierlotx differ by more than 1e-9 m, or when it is not 1,000 times as fast.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pygeodesy import pierlotx
from pygeodesy.vector3d import Vector3d
from scipy.optimize import least_squares

from planner.angles import subtended_angle, wrap_all
from planner.positioning import two_circle

CASES = 100_000
FIELD_M = 100.0
LEAST_CONDITIONING = 0.1
LEAST_DISTANCE_M = 2.0
BATCH = 4096
LEAST_SQUARES_CASES = 500
AGREEMENT_M = 1e-9
LEAST_RATIO = 1000.0

Points = NDArray[np.complex128]


def random_cases(count: int, rng: np.random.Generator) -> Points:
    """Receivers D and transmitters A, B, C, shape (4, count)."""
    kept: list[Points] = []
    while sum(batch.shape[1] for batch in kept) < count:
        d, a, b, c = batch = FIELD_M * (rng.uniform(-1, 1, (4, count)) + 1j * rng.uniform(-1, 1, (4, count)))
        distance_m = np.minimum.reduce([np.abs(p - q) for p, q in ((d, a), (d, b), (d, c), (a, b), (a, c), (b, c))])
        conditioning = two_circle(subtended_angle(d, a, b), subtended_angle(d, a, c), a, b, c).conditioning
        kept.append(batch[:, (conditioning > LEAST_CONDITIONING) & (distance_m > LEAST_DISTANCE_M)])
    return np.concatenate(kept, axis=1)[:, :count]


def seconds_per_solve(solve: Callable[[], object], solves: int) -> float:
    begin = time.perf_counter()
    solve()
    return (time.perf_counter() - begin) / solves


def by_pierlotx(a: Points, b: Points, c: Points, directions: NDArray[np.float64]) -> Points:
    """One by one, from the directions of A, B and C in the receiver's frame."""
    solved = np.empty_like(a)
    for k, (p, q, r, seen) in enumerate(zip(a.tolist(), b.tolist(), c.tolist(), np.degrees(directions).T, strict=True)):
        places = (Vector3d(z.real, z.imag, 0.0) for z in (p, q, r))
        found = pierlotx(*places, *seen.tolist())
        solved[k] = complex(found.x, found.y)
    return solved


def by_least_squares(
    a: Points, b: Points, c: Points, alpha: NDArray[np.float64], beta: NDArray[np.float64], near: Points
) -> Points:
    """One by one, from a start 5 m off the truth: better than it would have it in the field."""

    def misfit(xy: NDArray[np.float64], k: int) -> NDArray[np.float64]:
        at = complex(*xy)
        seen = np.array([subtended_angle(at, a[k], b[k]), subtended_angle(at, a[k], c[k])])
        return wrap_all(seen - [alpha[k], beta[k]])

    solved = np.empty_like(a)
    for k, start in enumerate(near):
        found = least_squares(misfit, (start.real, start.imag), args=(k,), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        solved[k] = complex(*found.x)
    return solved


def main(count: int) -> int:
    rng = np.random.default_rng(2025)
    d, a, b, c = random_cases(count, rng)
    alpha, beta = subtended_angle(d, a, b), subtended_angle(d, a, c)
    directions = np.angle(np.array([a, b, c]) - d) - rng.uniform(-math.pi, math.pi, count)

    fixes = two_circle(alpha, beta, a, b, c)
    batches = [slice(k, min(k + BATCH, count)) for k in range(0, count, BATCH)]
    batched_s = statistics.median(
        seconds_per_solve(lambda k=k: two_circle(alpha[k], beta[k], a[k], b[k], c[k]), k.stop - k.start)
        for k in batches
    )
    few = slice(0, min(count, LEAST_SQUARES_CASES))
    others: dict[str, Points] = {}

    def run(name: str, solve: Callable[[], Points], solves: int) -> float:
        def store() -> None:
            others[name] = solve()

        return seconds_per_solve(store, solves)

    pierlotx_s = run("pierlotx", lambda: by_pierlotx(a, b, c, directions), count)
    near = d[few] + 5.0 * np.exp(2j * np.pi * rng.random(d[few].size))
    scipy_s = run("scipy", lambda: by_least_squares(a[few], b[few], c[few], alpha[few], beta[few], near), near.size)

    print(f"{'solver':30}{'solves':>10}{'us/solve':>12}{'ratio':>10}{'apart, max m':>16}{'median m':>12}")
    for name, solves, seconds, apart in (
        (f"two_circle, batches of {BATCH}", count, batched_s, np.abs(fixes.position - d)),
        ("pygeodesy pierlotx, loop", count, pierlotx_s, np.abs(fixes.position - others["pierlotx"])),
        ("scipy least_squares, loop", near.size, scipy_s, np.abs(fixes.position[few] - others["scipy"])),
    ):
        print(
            f"{name:30}{solves:10d}{1e6 * seconds:12.3f}{seconds / batched_s:10.0f}"
            f"{apart.max():16.1e}{np.median(apart):12.1e}"
        )
    print("two_circle is compared with the truth, the others with two_circle")
    apart_m = np.abs(fixes.position - others["pierlotx"]).max()
    met = bool(fixes.valid.all()) and apart_m <= AGREEMENT_M and pierlotx_s / batched_s >= LEAST_RATIO
    print(
        f"agree to {AGREEMENT_M:g} m and at least {LEAST_RATIO:.0f} times as fast as pierlotx: {'yes' if met else 'NO'}"
    )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else CASES))
