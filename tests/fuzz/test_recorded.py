"""What a run left behind, damaged or made up: it is told as far as it goes, or refused with the file that is wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.messages import BearingReport, MalformedMessageError
from gcs.playbook.loader import load_playbook
from gcs.recording.bus_address import address_of
from gcs.recording.journal_reading import entries_of
from gcs.recording.topics import decoded
from gcs.replay.run import RunReplay
from gcs.reports.page import write_report
from gcs.resume.earlier import earlier_of
from gcs.resume.left_run import read_left_run
from gcs.resume.state import restored, run_state
from gcs.traced_monitor import MonitorNote
from planner.plan import plan_from_json
from tests.fuzz.hostile import as_json, damaged, ends_well, examples, mutated, values
from tests.gcs.replay.recorded import record
from tests.gcs.reports.virtual_run import fly

LINES = 40
"""So much of a series is as good as all of it."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run, with everything in it but its recording, and not all of its series."""
    folder = fly(tmp_path_factory.mktemp("runs"))
    (folder / "flight.mcap").unlink()
    series = (folder / "series.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "series.jsonl").write_bytes(b"".join(series[:: len(series) // LINES]))
    (folder / "bus.json").write_text('{"endpoint": "tcp/127.0.0.1:1", "swarm": "eight"}')
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with its recording."""
    return record(tmp_path_factory.mktemp("runs"), load_playbook(Path("sitl_configs/four.yaml")))


@st.composite
def spoilt(draw: st.DrawFn, data: bytes) -> bytes:
    """Return a JSON file, or the lines of one, with a part of it changed or damaged."""
    lines = data.splitlines() if data.count(b"\n{") else [data]
    for _ in range(draw(st.integers(1, 3))):
        number = draw(st.integers(0, len(lines) - 1))
        lines[number] = draw(damaged(lines[number]) | mutated(_document(lines[number])).map(as_json))
    return b"\n".join(lines)


def _document(line: bytes) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):  # damaged before
        return {}


def copied(folder: Path, to: Path) -> Path:
    shutil.rmtree(to, ignore_errors=True)
    return Path(shutil.copytree(folder, to))


@examples(10)
@given(data=st.data())
def test_a_report_of_what_is_left(flown: Path, tmp_path: Path, data: st.DataObject) -> None:
    run = copied(flown, tmp_path / "run")
    name = data.draw(st.sampled_from(sorted(path.name for path in run.iterdir() if path.suffix in (".json", ".jsonl"))))
    (run / name).write_bytes(data.draw(spoilt((run / name).read_bytes())))
    with ends_well(20.0):
        write_report(run)


@examples(5)
@given(data=st.data())
def test_a_recording_that_is_damaged_is_replayed_as_far_as_it_goes(
    recorded: Path, tmp_path: Path, data: st.DataObject
) -> None:
    run = copied(recorded, tmp_path / "run")
    flight = run / "flight.mcap"
    flight.write_bytes(data.draw(damaged(flight.read_bytes()[:60_000])))
    with ends_well(20.0):
        replay = RunReplay(run, {"monitor.slot.band_m": 1.0})
        for _ in replay.messages():
            pass
        assert not replay.sound
        assert all(replay.complaints)


@examples(30)
@given(data=st.data())
def test_a_run_that_is_to_go_on(flown: Path, tmp_path: Path, data: st.DataObject) -> None:
    run = copied(flown, tmp_path / "run")
    name = data.draw(st.sampled_from(("playbook.json", "plan.json", "run.json", "bus.json")))
    (run / name).write_bytes(data.draw(spoilt((run / name).read_bytes())))
    with ends_well():
        address_of(run)
    with ends_well():
        RunReplay(run, {}).records()
    with ends_well():
        read_left_run(run)


@examples(50)
@given(data=st.data())
def test_a_journal_gives_what_is_whole_in_it(flown: Path, data: st.DataObject) -> None:
    lines = data.draw(spoilt((flown / "journal.jsonl").read_bytes())).splitlines()
    read = entries_of(lines)
    assert len(read.entries) + len(read.lost) == len(lines)
    plan = plan_from_json(json.loads((flown / "plan.json").read_bytes()))
    with ends_well():
        assert restored(plan, run_state(read.entries)).records


@examples(30)
@given(data=st.data())
def test_a_series_gives_what_is_whole_in_it(flown: Path, data: st.DataObject) -> None:
    lines = data.draw(spoilt((flown / "series.jsonl").read_bytes())).splitlines()
    with ends_well():
        earlier_of(lines, now_ns=2**62)


@pytest.mark.parametrize("topic", ["bearing-relay/x/uav/U1/bearings", "monitor/U1", "nobody/knows/it"])
@examples(20)
@given(data=st.data())
def test_a_recorded_message_is_one_or_malformed(topic: str, data: st.DataObject) -> None:
    payload = data.draw(values.map(as_json) | st.binary(max_size=40) | st.just(b'{"a":' * 3000))
    try:
        said = decoded(payload, topic)
    except MalformedMessageError as error:
        assert str(error)  # noqa: PT017 - most are malformed, and none has to be
        return
    assert isinstance(said, dict | BearingReport | MonitorNote)
