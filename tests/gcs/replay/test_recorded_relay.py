"""Relays flown by the real executor, recorded and replayed: every decision of theirs comes out to the sample."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.commands.options import changed
from gcs.playbook.loader import load_playbook
from gcs.recording.mcap_file import SizeLimits
from gcs.replay.run import RunReplay
from gcs.simulate.world import RelayWorld
from tests.gcs.replay.recorded import record
from tests.gcs.simulate.small import small

TROUBLES = {
    "noise": "sensor: {sigma_deg: 0.5}\n",
    "outliers, loss and gaps": (
        "sensor: {sigma_deg: 0.2, drop_out: 0.2, faults: {outlier_share: 0.05, gaps: {every_s: 10, for_s: 1.5}}}\n"
    ),
    "a clock that is off": "sensor: {sigma_deg: 0.2, faults: {clock_offset_s: -3, clock_drift_ppm: 50}}\n",
    "directions from the nose": "sensor: {sigma_deg: 0.1, reference: body}\n",
    "wind": "simulation: {wind_mps: 5, wind_from_deg: 45, gusts_mps: 1}\n",
}


def replayed(folder: Path) -> RunReplay:
    run = RunReplay(folder, {})
    for _ in run.messages():
        pass
    return run


@pytest.mark.parametrize("more", TROUBLES.values(), ids=TROUBLES)
def test_every_decision_comes_out_whatever_the_trouble(tmp_path: Path, more: str) -> None:
    run = replayed(record(tmp_path, small(tmp_path, more, two=True)))
    assert run.sound, (run.complaints, run.audit.unsaid, [flight.difference for flight in run.flights])
    assert {flight.receiver for flight in run.flights} == {"U1", "U2"}
    for flight in run.flights:
        assert flight.recorded is not None
        assert flight.recorded == flight.replayed
        assert flight.largest_difference_m == 0.0


def test_the_paper_s_eight_come_out(tmp_path: Path) -> None:
    playbook = changed(load_playbook(Path("sitl_configs/paper_8.yaml")), "sensor", sigma_deg=0.3)
    run = replayed(record(tmp_path, playbook, limits=SizeLimits(part_bytes=400_000)))
    assert run.sound
    assert len(run.flights) >= 16
    assert all(flight.recorded == flight.replayed for flight in run.flights)


def test_a_receiver_that_was_held_has_a_leg_without_a_stop(tmp_path: Path) -> None:
    def go_silent(world: RelayWorld) -> None:
        world.tamper = lambda name, payload: payload if world.clock.now_s() < 3.0 else None

    run = replayed(record(tmp_path, small(tmp_path), prepare=go_silent))
    assert run.sound
    (turn,) = run.flights
    assert (turn.recorded, turn.replayed) == (None, None)
    assert turn.samples > 5
