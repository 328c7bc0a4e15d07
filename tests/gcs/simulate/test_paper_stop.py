"""The paper's raw stop, which the relay is compared with: it is what the paper says, and no worse."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import pytest
from msgspec.structs import replace

from drivers.bus.messages import BearingReport, decode, encode
from gcs.simulate.bus import LocalBus
from gcs.simulate.outcome import RunResult, fly_once
from gcs.simulate.paper_stop import RawStop
from gcs.simulate.scored import ScoredWorld
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from planner.routes import make_leg
from tests.gcs.simulate.small import small

L0, L1 = ("L0", 0j), ("L1", 100 + 0j)
SIGMA = {"L0": math.radians(0.5), "L1": math.radians(0.5)}
AWAY = RawStop(make_leg(30 + 40j, 60 + 80j, L0, (L0, L1)), dict([L0, L1]))
TOWARDS = RawStop(make_leg(60 + 80j, 30 + 40j, L0, (L0, L1)), dict([L0, L1]))


def seen_from(place: complex) -> dict[str, float]:
    return {name: cmath.phase(at - place) for name, at in (L0, L1)}


@pytest.mark.parametrize("stop", [AWAY, TOWARDS])
def test_it_stops_within_two_sigma_of_the_angle_or_beyond_it_and_not_before(stop: RawStop) -> None:
    def reached(beyond_m: float) -> bool:
        return stop.reached(seen_from(stop.leg.end + beyond_m * stop.course), SIGMA)

    ahead = [off_m / 10.0 for off_m in range(-500, 300) if reached(off_m / 10.0)]
    assert ahead == [off_m / 10.0 for off_m in range(round(10 * ahead[0]), 300)]
    at_first = seen_from(stop.leg.end + ahead[0] * stop.course)
    off_rad = abs(at_first["L1"] - at_first["L0"] - stop.leg.stop_angle_rad)
    assert 0.9 * 2.0 * math.sqrt(2.0) * SIGMA["L0"] < off_rad <= 2.0 * math.sqrt(2.0) * SIGMA["L0"]
    exact = dict.fromkeys(SIGMA, 0.0)
    assert not stop.reached(seen_from(stop.leg.end - 0.01 * stop.course), exact)
    assert stop.reached(seen_from(stop.leg.end + 0.01 * stop.course), exact)


@pytest.mark.parametrize("stop", [AWAY, TOWARDS])
@pytest.mark.parametrize("aside_m", [-3.0, 3.0])
def test_it_flies_at_constant_speed_and_back_onto_its_line(stop: RawStop, aside_m: float) -> None:
    middle = (stop.leg.start + stop.leg.end) / 2.0
    assert stop.velocity(seen_from(middle)["L0"], 5.0) == pytest.approx(5.0 * stop.course)
    assert stop.velocity(None, 5.0) == pytest.approx(5.0 * stop.course)
    back = stop.velocity(seen_from(middle + aside_m * 1j * stop.course)["L0"], 5.0) / stop.course
    assert abs(back) == pytest.approx(5.0)
    assert back.imag * aside_m < 0.0
    assert back.real > 4.0


def test_it_takes_the_bearings_of_the_guide_and_of_both_references() -> None:
    assert AWAY.usable({"L0": 0.0, "L1": 1.0, "U9": 2.0})
    assert not AWAY.usable({"L0": 0.0})


def fly(folder: Path, stop: str, speed: str, seed: int = 1) -> RunResult:
    playbook = small(folder, "planner: {method: paper}\n")
    flight = playbook.flight.model_copy(update={"speed_mps": float(speed)})
    playbook = playbook.model_copy(update={"flight": flight})
    return fly_once(playbook, playbook.plan(), seed, stop)


def test_it_is_good_when_slow_runs_on_when_fast_and_the_filtered_stop_is_neither(tmp_path: Path) -> None:
    filtered, raw, slow = (fly(tmp_path, *how) for how in (("filtered", "4.0"), ("raw", "4.0"), ("raw", "1.0")))
    assert [run.outcome for run in (filtered, raw, slow)] == ["formed"] * 3
    errors_m = [run.receivers[0].placement_error_m for run in (filtered, raw, slow)]
    assert errors_m[0] < 0.3
    assert errors_m[1] > 2.0
    assert errors_m[2] < 0.8
    assert slow.duration_s > 1.5 * filtered.duration_s
    assert fly(tmp_path, "raw", "4.0") == raw


@pytest.mark.parametrize("fault", ["silent", "frozen"])
def test_nothing_comes_or_the_angle_never_does(tmp_path: Path, fault: str) -> None:
    """Without news it stops like any other; one that never comes it flies past until the leg has taken far too long."""
    playbook = small(tmp_path, "planner: {method: paper}\n")
    clock = VirtualClock()

    async def watched() -> None:
        world = ScoredWorld(playbook, playbook.plan(), clock, LocalBus(), seed=1, stop="raw")
        kept: list[BearingReport] = []

        def tamper(_: str, payload: bytes) -> bytes | None:
            report = decode(payload, BearingReport)
            if clock.now_s() < 4.0:
                kept[:] = [report]
                return payload
            if fault == "silent":
                return None
            wobble_rad = 1e-3 * clock.now_s() % 1.0
            frozen = [replace(one, azimuth_rad=one.azimuth_rad + wobble_rad) for one in kept[0].bearings]
            return encode(replace(report, bearings=frozen))

        world.tamper = tamper
        before = world.vehicles["U1"].place
        await world.run(200.0)
        record, flown_s = world.executor.records["U1"], clock.now_s() - 4.0
        assert not world.executor.formed
        if fault == "silent":
            assert record.reason == "no bearings for its leg for 2 s"
            assert flown_s < 3.0
        else:
            assert "its stop angle did not come within" in record.reason
            assert flown_s > 30.0
            assert abs(world.vehicles["U1"].place - before) > 100.0
        await world.hover(10.0)
        assert abs(world.vehicles["U1"].velocity) < 0.05

    run_virtually(watched())
