"""Which runs can go on, with whom, and with which of their stages."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.mavlink.autopilots.ardupilot import ArduCopter
from drivers.mavlink.checks import Intent
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.playbook.stage_rules import NamedStage
from gcs.preflight.expected import Expected
from gcs.preflight.facts import VehicleFacts
from gcs.recording.facts import RunFacts
from gcs.recording.journal import open_journal
from gcs.recording.journal_reading import entries_of, read_journal
from gcs.recording.run_folder import write_json
from gcs.resume.adoption import on_the_ground, require_enough
from gcs.resume.left_run import read_left_run
from gcs.resume.resumption import stages_left
from planner.frames import GeodeticPosition, SiteFrame
from planner.plan import plan_to_json
from tests.gcs.resume.killed import PLAN, PLAYBOOK

LINKS = {
    name: {"link": f"udpin:127.0.0.1:{15000 + number}", "system_id": number}
    for number, name in enumerate(PLAYBOOK.uavs, start=1)
}
STAGES = [
    "preflight", "takeoff", {"emission": {"on": ["L0"]}}, {"wait": {"for_s": 1}}, "relay", {"hold": {"for_s": 1}},
    "measure", "land",
]  # fmt: skip


def playbook(**changes: object) -> Playbook:
    written = PLAYBOOK.model_dump(mode="json") | {"target": None, "vehicles": LINKS} | changes
    return Playbook.model_validate(written)


def left(folder: Path, book: Playbook) -> Path:
    """A run's folder as its service leaves it."""
    write_json(folder / "playbook.json", book.model_dump(mode="json"))
    write_json(folder / "plan.json", plan_to_json(PLAN))
    write_json(folder / "run.json", {"started_ns": 5, "speedup": 1.0, "seed": 3, "sitl": None, "versions": {}})
    return folder


def stage_line(name: str, kind: str, state: str) -> bytes:
    return json.dumps({"time_ns": 1, "stage": name, "kind": kind, "state": state, "reason": ""}).encode()


def words(stages: list[NamedStage]) -> list[str]:
    return [stage.name for stage in stages]


def test_a_run_comes_back_as_it_was_flown(tmp_path: Path) -> None:
    book = playbook(stages=STAGES)
    found = read_left_run(left(tmp_path, book))
    assert found.playbook == book
    assert found.plan.routes == PLAN.routes or [route.receiver for route in found.plan.routes] == list(book.receivers)
    assert found.facts == RunFacts(5, 1.0, 3, None, {})


def test_a_run_whose_vehicles_ended_with_its_service_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="have ended with it"):
        read_left_run(left(tmp_path, playbook(vehicles=None)))


@pytest.mark.parametrize("name", ["playbook.json", "plan.json", "run.json"])
@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"a": '])
def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, name: str, content: str | None) -> None:
    path = left(tmp_path, playbook()) / name
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(ServiceError, match="is no run that can go on"):
        read_left_run(tmp_path)


def test_a_folder_without_a_journal_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="Name the folder of a run"):
        read_journal(tmp_path / "journal.jsonl")


def test_every_service_that_goes_on_has_logs_of_its_own(tmp_path: Path) -> None:
    run = read_left_run(left(tmp_path, playbook()))
    assert [run.new_logs().name for _ in range(2)] == ["resumed-1", "resumed-2"]


def test_a_run_is_flown_by_one_service_at_a_time(tmp_path: Path) -> None:
    with (
        open_journal(tmp_path / "journal.jsonl"),
        pytest.raises(ServiceError, match="its service is still running"),
        open_journal(tmp_path / "journal.jsonl"),
    ):
        pass
    with open_journal(tmp_path / "journal.jsonl"):
        pass


def test_of_a_playbook_without_stages_the_relay_and_the_landing_are_left() -> None:
    flight = PLAYBOOK.flight.model_dump(mode="json")
    assert words(stages_left(playbook().flow, ())) == ["relay"]
    assert words(stages_left(playbook(flight=flight | {"land_after": True}).flow, ())) == ["relay", "land"]


def test_before_the_relay_only_transmitters_are_switched_again_and_after_it_nothing_is_done_twice() -> None:
    flow = playbook(stages=STAGES).flow
    lines = [stage_line(name, name, "done") for name in ("preflight", "takeoff", "emission", "wait")]
    assert words(stages_left(flow, ())) == ["relay", "hold", "measure", "land"]
    assert words(stages_left(flow, entries_of(lines).entries)) == ["emission", "relay", "hold", "measure", "land"]
    lines += [stage_line("relay", "relay", "done"), stage_line("hold", "hold", "done")]
    lines += [stage_line("measure", "measure", "begun")]
    assert words(stages_left(flow, entries_of(lines).entries)) == ["emission", "relay", "measure", "land"]
    assert not {"arm", "takeoff"} & {stage.kind for stage in stages_left(flow, entries_of(lines).entries)}


def test_a_playbook_without_a_relay_has_nothing_to_resume() -> None:
    flow = playbook(stages=["preflight", "takeoff", {"hold": {"for_s": 1}}, "land"]).flow
    with pytest.raises(ServiceError, match="has no relay"):
        stages_left(flow, ())


def expected(altitude_m: float) -> Expected:
    intent = Intent(altitude_m=altitude_m, speed_mps=5.0, reach_m=100.0, station_system_id=255)
    return Expected(intent, None, 0j, 1.0, 5.0, SiteFrame(GeodeticPosition(47.0, 8.0, 400.0)))


def facts(**changes: object) -> VehicleFacts:
    found = VehicleFacts(
        name="U1", expected=expected(20.0), autopilot=ArduCopter(), identities=frozenset(), contested=False,
        missing_messages=(), not_ready="", armed=True, pre_arm=None, battery=None, clock=None, parameters={},
        height_m=20.0, home_altitude_m=400.0, place=0j,
    )  # fmt: skip
    return replace(found, **changes)


def test_one_that_is_disarmed_or_on_the_ground_takes_no_part() -> None:
    assert on_the_ground(facts()) is None
    assert on_the_ground(facts(height_m=None)) is None
    assert on_the_ground(facts(height_m=2.0, expected=expected(altitude_m=2.0))) is None
    assert "arms nobody" in (on_the_ground(facts(armed=False)) or "")
    assert "takes nobody off" in (on_the_ground(facts(height_m=0.2)) or "")


def test_it_takes_two_transmitters_and_a_receiver_in_the_air() -> None:
    require_enough(PLAYBOOK, {"U1", "U2"})
    with pytest.raises(ServiceError, match="L1, U1 are on the ground or done without"):
        require_enough(PLAYBOOK, {"L1", "U1"})
    with pytest.raises(ServiceError, match="takes two transmitters and a receiver"):
        require_enough(PLAYBOOK, set(PLAYBOOK.receivers))
