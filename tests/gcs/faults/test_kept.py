"""What a relay announced and said is in its records when it has ended, however it ended; and what is not is found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gcs.faults.fault import Fault, Moment
from gcs.faults.outcome import FaultRun, fly_faults
from gcs.playbook.schema import Playbook
from gcs.recording import mcap_file
from gcs.recording.flight import Recording
from gcs.recording.journal import Journal
from gcs.recording.mcap_file import McapFiles
from gcs.recording.series import Series
from gcs.relay.records import ReceiverRecord
from tests.gcs.simulate.small import small

WHOLE, JOURNAL_ALONE = 4, 5
KILLED = Fault("service_killed", "U1", Moment("U1", "LEG_2", 3.0), None)


@pytest.fixture
def playbook(tmp_path: Path) -> Playbook:
    return small(tmp_path, two=True)


def fly(playbook: Playbook, *faults: Fault, seed: int = WHOLE) -> FaultRun:
    return fly_faults(playbook, playbook.plan(), seed, faults, attended=True)


def lost(run: FaultRun) -> list[str]:
    assert {finding.invariant for finding in run.violations} <= {"recorded"}
    return [finding.what for finding in run.violations]


@pytest.mark.parametrize(
    "struck",
    [
        Fault("link_cut", "U1", Moment("U1", "LEG_2", 0.0), None),
        Fault("bus_lost", "U1", Moment("U1", "LEG_1", 0.1), 4.0),
        Fault("pilot_receiver", "U1", Moment("U1", "LEG_2", 0.1), None),
        Fault("service_stopped", "U1", Moment("U1", "LEG_2", 2.0), 4.0),
        Fault("service_killed", "U1", Moment("U1", "LEG_2", 0.0), None),
        Fault("service_killed", "U2", Moment("U2", "VERIFYING", 0.1), None),
    ],
    ids=lambda struck: f"{struck.kind} in {struck.at.state}",
)
def test_nothing_is_lost_whatever_fails(playbook: Playbook, struck: Fault) -> None:
    run = fly(playbook, struck)
    assert run.struck_s[0] is not None
    assert lost(run) == []


@pytest.mark.parametrize("seed", [WHOLE, JOURNAL_ALONE])
def test_a_line_that_the_journal_loses_is_found_in_every_run(
    playbook: Playbook, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    append = Journal.append

    def lose(self: Journal, entry: Mapping[str, Any]) -> None:
        if entry.get("state") != "LEG_2":
            append(self, entry)

    monkeypatch.setattr(Journal, "append", lose)
    (told,) = lost(fly(playbook, seed=seed))
    assert told.startswith("journal.jsonl: ")
    assert "LEG_2" in told


def test_a_message_that_is_not_recorded_is_found(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    note, noted = Recording.note, []

    def lose_one(self: Recording, key: str, payload: bytes) -> None:
        noted.append(key)
        if len(noted) != 50:
            note(self, key, payload)

    monkeypatch.setattr(Recording, "note", lose_one)
    (told,) = lost(fly(playbook))
    assert told.startswith(f"flight.mcap: what was said on {noted[49]}")


def test_a_recording_that_stops_is_found(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError("no space is left")

    monkeypatch.setattr(McapFiles, "write", full)
    assert "no space is left" in lost(fly(playbook))[0]


def test_messages_that_a_killed_service_still_held_are_found(
    playbook: Playbook, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert lost(fly(playbook, KILLED)) == []
    monkeypatch.setattr(mcap_file, "_FLUSH_NS", 10**9)
    assert lost(fly(playbook)) == []
    assert "flight.mcap: what was said on" in lost(fly(playbook, KILLED))[0]


@pytest.mark.parametrize("seed", [WHOLE, 2 * WHOLE, 3 * WHOLE])
def test_what_came_last_before_a_silence_outlives_a_service_killed_in_it(playbook: Playbook, seed: int) -> None:
    silence = Fault("bus_lost", "U1", Moment("U1", "LOCATING", 0.1), None)
    killed = Fault("service_killed", "U1", Moment("U1", "LOCATING", 1.5), None)
    run = fly(playbook, silence, killed, seed=seed)
    assert None not in run.struck_s
    assert lost(run) == []


@pytest.mark.parametrize("method", ["_note_legs", "_note_stops"])
def test_a_leg_or_a_stop_that_the_series_misses_is_found(
    playbook: Playbook, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    monkeypatch.setattr(Series, method, lambda *_: None)
    assert "series.jsonl: the " in lost(fly(playbook))[0]


def test_a_leg_that_nobody_told_of_is_found(playbook: Playbook, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = Series._begun

    def twice(self: Series, record: ReceiverRecord, *flown: Any) -> None:
        begun(self, record, *flown)
        begun(self, record, *flown)

    monkeypatch.setattr(Series, "_begun", twice)
    assert "nobody told of it" in lost(fly(playbook))[0]
