"""A simulated relay: formed from bearings alone, the same for the same seed, held by faults, and honestly scored."""

from __future__ import annotations

import cmath
from pathlib import Path

import pytest

from gcs.playbook.loader import load_playbook
from gcs.simulate.bus import LocalBus
from gcs.simulate.outcome import RunResult, fly_once
from gcs.simulate.scored import ScoredWorld, stop_error_m
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from planner.routes import make_leg
from tests.gcs.simulate.small import small, small_text

FAULTS = "sensor: {{sigma_deg: 0.1, drop_out: {loss}, faults: {{{faults}}}}}\n"


def fly(folder: Path, more: str = "", seed: int = 1) -> RunResult:
    playbook = small(folder, more)
    return fly_once(playbook, playbook.plan(), seed)


def test_it_forms_and_every_number_is_there(tmp_path: Path) -> None:
    run = fly(tmp_path)
    (u1,) = run.receivers
    assert (run.outcome, run.reason, u1.state, u1.reason) == ("formed", "", "PLACED", "")
    assert u1.placement_error_m == pytest.approx(u1.hover_error_m, abs=0.1)
    assert u1.placement_error_m < 0.5
    assert abs(u1.stop_error_m) < 0.5
    assert 0.0 <= u1.overshoot_m < 1.0
    assert u1.flown_length_m == pytest.approx(u1.planned_length_m, abs=2.0)
    assert 5.0 < u1.duration_s <= run.duration_s < 60.0
    assert run.emission_transmitter_s == pytest.approx(2 * run.duration_s, rel=0.1)
    assert 20.0 < run.min_separation_m < 80.0


def test_a_seed_flies_the_same_again_and_another_does_not(tmp_path: Path) -> None:
    assert fly(tmp_path, seed=4) == fly(tmp_path, seed=4)
    assert fly(tmp_path, seed=4).receivers != fly(tmp_path, seed=5).receivers


def test_gusts_and_wind_are_flown_in(tmp_path: Path) -> None:
    run = fly(tmp_path, "simulation: {wind_mps: 5, wind_from_deg: 45, gusts_mps: 1}\n")
    assert run.outcome == "formed"
    assert run.receivers[0].placement_error_m < 1.0
    assert run.receivers[0].placement_error_m != run.receivers[0].hover_error_m


def test_bearings_from_the_nose_are_flown_by_too(tmp_path: Path) -> None:
    path = tmp_path / "body.yaml"
    text = small_text("sensor: {reference: body}\n").replace("  L1:", "  L2: {at: [40, 90]}\n  L1:")
    path.write_text(text, encoding="utf-8")
    playbook = load_playbook(path)
    run = fly_once(playbook, playbook.plan(), 1)
    assert (run.outcome, run.reason) == ("formed", "")
    assert run.receivers[0].placement_error_m < 0.5


@pytest.mark.parametrize(
    ("loss", "faults"),
    [
        (0.3, ""),
        (0.0, "outlier_share: 0.05"),
        (0.0, "bearing_drop_out: 0.2"),
        (0.0, "gaps: {every_s: 10, for_s: 1.5}"),
        (0.0, "stuck: {every_s: 10, for_s: 1.5}"),
        (0.0, "latency_jitter_s: 0.1"),
        (0.0, "clock_offset_s: -3, clock_drift_ppm: 50"),
    ],
)
def test_faults_that_pass_are_survived(tmp_path: Path, loss: float, faults: str) -> None:
    run = fly(tmp_path, FAULTS.format(loss=loss, faults=faults), seed=2)
    assert run.outcome == "formed"
    assert run.receivers[0].placement_error_m < 0.7


def test_a_sensor_that_says_nothing_holds_its_receiver(tmp_path: Path) -> None:
    run = fly(tmp_path, FAULTS.format(loss=0.999, faults=""))
    assert run.outcome == "held"
    assert "reports with bearings" in run.reason
    assert run.receivers[0].placement_error_m is None
    assert run.receivers[0].stop_error_m is None


@pytest.mark.parametrize("fault", ["gaps", "stuck"])
def test_nothing_flies_on_without_news(tmp_path: Path, fault: str) -> None:
    """Within a second of the last news the command is zero, and the relay is held when nothing comes again."""
    playbook = small(tmp_path)
    clock = VirtualClock()

    async def watched() -> None:
        world = ScoredWorld(playbook, playbook.plan(), clock, LocalBus(), seed=1)
        u1, kept, since_s = world.vehicles["U1"], [], []

        def tamper(name: str, payload: bytes) -> bytes | None:
            if clock.now_s() < 8.0:
                kept[:] = [payload]
                return payload
            since_s[:] = since_s or [clock.now_s()]
            return kept[0] if fault == "stuck" else None

        world.tamper = tamper
        measured = world.measure

        def measure() -> None:
            measured()
            if since_s and clock.now_s() > since_s[0] + 1.0:
                assert u1.command == 0j

        world.measure = measure
        await world.run(60.0)
        assert since_s
        assert not world.executor.formed
        assert clock.now_s() < since_s[0] + playbook.flight.give_up_s + 2.0
        await world.hover(5.0)
        assert abs(u1.velocity) < 0.05

    run_virtually(watched())


def test_the_stop_error_is_the_way_to_where_the_angle_is_seen() -> None:
    stands = {"L0": 0j, "L1": 100 + 0j}
    leg = make_leg(30 + 40j, 60 + 80j, ("L0", 0j), (("L0", 0j), ("L1", 100 + 0j)))
    course = cmath.rect(1.0, cmath.phase(3 + 4j))
    assert stop_error_m(leg, leg.end, stands) == pytest.approx(0.0, abs=1e-9)
    for beyond_m in (-0.5, 0.2):
        assert stop_error_m(leg, leg.end + beyond_m * course, stands) == pytest.approx(beyond_m, rel=0.03)


def test_a_transmitter_that_stands_elsewhere_moves_the_place_where_the_angle_is_seen() -> None:
    """Who stops by the angle stops there: that is no error of his stop."""
    stands = {"L0": 0j, "L1": 100 + 0j}
    leg = make_leg(30 + 40j, 60 + 80j, ("L0", 0j), (("L0", 0j), ("L1", 100 + 0j)))
    assert abs(stop_error_m(leg, leg.end, {**stands, "L1": 101 + 0j})) > 0.1
    assert stop_error_m(leg, leg.end, {"L0": -10 * (3 + 4j), "L1": 10 * (3 + 4j)}) is None
