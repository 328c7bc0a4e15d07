"""What a run leaves behind: the folder, the journal, the score and the report."""

from __future__ import annotations

import asyncio
import json
import math
import os
import resource
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from drivers.mavlink.link_status import LinkState, LinkStatus
from gcs.errors import ServiceError
from gcs.recording.journal import open_journal
from gcs.recording.lines import open_lines
from gcs.recording.run_folder import RunFolder, write_json
from gcs.recording.score import Score
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.report_checks import BearingCounters
from gcs.reports.run_report import RunFigures, run_report
from gcs.safety import PositionBoard, SitePosition
from planner.frames import FormationFrame
from planner.methods.paper import plan
from planner.plan import RelayPlan
from planner.relay import RelayProblem

NOON = datetime(2026, 11, 22, 12, 0, 0, tzinfo=UTC)


def test_two_runs_of_one_second_get_two_folders(tmp_path: Path) -> None:
    first, second = (RunFolder.create(tmp_path / "runs", "paper-8", NOON) for _ in range(2))
    assert first.path.name == "20261122T120000-paper-8"
    assert first.path != second.path
    assert first.logs.is_dir()


def test_a_place_where_no_folder_can_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ServiceError, match="--runs-dir"):
        RunFolder.create(tmp_path / "file", "x")


def test_json_refuses_nan_and_says_where_it_cannot_write(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"a": math.nan})
    with pytest.raises(ServiceError, match="cannot be written"):
        write_json(tmp_path / "no" / "x.json", {})


def test_the_journal_only_grows_and_is_complete_after_the_block(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    for part in range(2):
        with open_journal(path) as journal:
            for number in range(50):
                journal.append({"part": part, "number": number})
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    assert entries == [{"part": part, "number": number} for part in range(2) for number in range(50)]


def test_a_full_disk_stops_the_journal_loudly_and_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    with open_journal(Path("/dev/full")) as journal:
        journal.append({"a": 1})
        journal.append({"a": 2})
    messages = [record.getMessage() for record in caplog.records]
    assert len(messages) == 1
    assert "No space left" in messages[0]
    assert "the flight goes on" in messages[0]


async def test_the_operator_is_told_when_lines_are_lost_and_when_they_are_written_again(tmp_path: Path) -> None:
    path, said = tmp_path / "journal.jsonl", list[str]()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    async def until_said(count: int) -> None:
        async with asyncio.timeout(20.0):
            while len(said) < count:  # noqa: ASYNC110 - the disk tells nobody
                await asyncio.sleep(0.01)

    with open_journal(path, said.append) as journal:
        journal.append({"a": 1})
        journal.append({"a": 2})
        while path.read_bytes().count(b"\n") < 2:  # noqa: ASYNC110 - as above
            await asyncio.sleep(0.01)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
        try:
            journal.append({"a": 3})
            journal.append({"a": 4})
            await until_said(1)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        journal.append({"a": 5})
        await until_said(2)
    assert "journal.jsonl: [Errno 27] File too large: recording has stopped, the flight goes on" in said[0]
    assert "it can be written again" in said[1]
    assert [json.loads(line)["a"] for line in path.read_text().splitlines()][:2] == [1, 2]
    assert path.read_text().endswith('{"a": 5}\n')


def test_a_document_that_cannot_be_written_leaves_the_one_before_whole(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_json("plan.json", {"a": 1})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3, before[1]))
    try:
        with pytest.raises(ServiceError, match=r"plan\.json cannot be written: .*File too large"):
            folder.write_json("plan.json", {"a": 2})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert json.loads((tmp_path / "plan.json").read_text()) == {"a": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]
    folder.write_json("plan.json", {"a": 3})
    assert json.loads((tmp_path / "plan.json").read_text()) == {"a": 3}


def test_a_journal_that_cannot_be_opened_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="journal"), open_journal(tmp_path / "no" / "journal.jsonl"):
        pass


def test_a_line_that_fitted_only_in_part_spoils_no_other(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b'{"a": 1}\n{"a": 2, "torn')
    with open_journal(path) as journal:
        journal.append({"a": 3})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with open_lines(path, synced=False) as lines:
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 5, before[1]))
        try:
            lines.append(b'{"a": 4, "long": "x"}')
            while not path.read_bytes().endswith(b'{"a":'):
                time.sleep(0.01)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        lines.append(b'{"a": 5}')
    assert path.read_text().splitlines() == ['{"a": 1}', '{"a": 2, "torn', '{"a": 3}', '{"a":', '{"a": 5}']


@pytest.fixture
def relay() -> RelayPlan:
    return plan(RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U1": 40 + 70j}, {"O1": 70 + 60j}))


def flown(relay: RelayPlan) -> tuple[ReceiverRecord, Score]:
    """A receiver flown 1 m at a time along the x axis of the formation, past a vehicle 7 m beside it."""
    record = ReceiverRecord(relay.routes[0])
    frame, board = FormationFrame(0.7), PositionBoard()
    score = Score(frame, board, {"U1": record})

    def move(name: str, place: complex) -> None:
        board.latest[name] = SitePosition(0.0, frame.to_site(place), 20.0)
        score.moved(name)

    move("L0", 5 + 7j)
    move("U1", 0j)
    record.state = ReceiverState.LEG_1
    record.legs.append(LegRecord(record.route.legs[0], started_s=10.0))
    for step in range(1, 11):
        move("U1", complex(step))
    record.legs[0].ended_s, record.legs[0].stop_angle_error_rad = 15.0, math.radians(0.5)
    record.state = ReceiverState.HELD
    move("U1", 20 + 0j)
    return record, score


def test_the_score_counts_what_was_flown_on_legs_and_the_closest_approach(relay: RelayPlan) -> None:
    record, score = flown(relay)
    assert score.leg_lengths_m == {("U1", 0): pytest.approx(10.0)}
    assert score.min_separation_m == pytest.approx(7.0)
    assert score.placement_error_m(record) == pytest.approx(abs(20 - record.route.target))
    assert score.tracks["U1"][-1] == pytest.approx(10 + 0j)
    assert "L0" not in score.tracks


def test_the_report_has_the_documented_form(relay: RelayPlan) -> None:
    record, score = flown(relay)
    silent = LinkStatus("udpin:h:1", LinkState.SILENT, 90, 80, 7, 6, 5, 4, None, math.inf, (1,), ())
    counters = BearingCounters(received=9, stale=2)
    figures = RunFigures("test", "aborted", 60.0, 120.0, counters, links=[("L0, L1", silent)])
    report = run_report(figures, relay, {"U1": record}, score)
    json.dumps(report, allow_nan=False)
    assert set(report) == {
        "playbook", "outcome", "planned_total_length_m", "flown_total_length_m", "straight_line_bound_m",
        "min_separation_m", "duration_s", "emission_transmitter_s", "bearing_reports", "links", "receivers",
        "stages", "verdicts",
    }  # fmt: skip
    assert report["bearing_reports"] == {
        "received": 9, "stale": 2, "duplicate": 0, "out_of_order": 0, "from_the_future": 0, "stuck": 0,
        "without_heading": 0, "malformed": 0, "unknown_sender": 0,
    }  # fmt: skip
    assert report["links"] == [
        {"vehicles": "L0, L1", "address": "udpin:h:1", "state": "silent", "received": 90, "sent": 80, "lost": 7,
         "refused": 6, "dropped": 5, "skipped_bytes": 4},
    ]  # fmt: skip
    receiver = report["receivers"][0]
    assert {"name", "slot", "state", "route_model", "transmitters", "placement_error_m", "legs"} <= set(receiver)
    first, second = receiver["legs"]
    assert set(first) == {
        "planned_length_m", "flown_length_m", "stop_angle_deg", "stop_angle_error_deg", "outliers", "duration_s",
    }  # fmt: skip
    assert (first["flown_length_m"], first["duration_s"]) == (pytest.approx(10.0), 5.0)
    assert first["stop_angle_error_deg"] == pytest.approx(0.5)
    assert (second["flown_length_m"], second["stop_angle_error_deg"], second["duration_s"]) == (None, None, None)


def test_a_receiver_nobody_heard_of_has_no_placement_error(relay: RelayPlan) -> None:
    record = ReceiverRecord(relay.routes[0])
    score = Score(FormationFrame(0.0), PositionBoard(), {"U1": record})
    assert score.placement_error_m(record) is None
    assert score.min_separation_m is None


def test_the_journal_s_file_is_readable_by_others(tmp_path: Path) -> None:
    with open_journal(tmp_path / "j"):
        pass
    assert os.stat(tmp_path / "j").st_mode & 0o444
