"""A run's folder replayed by the command: decisions, what the record does not vouch for, and the live screen."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from mcap.reader import make_reader
from rich.console import Console

from drivers.bus.messages import BearingReport, encode
from gcs.commands.replay import replay
from gcs.errors import ServiceError
from gcs.monitor.terminal import progress_view
from gcs.recording.mcap_file import SizeLimits
from gcs.recording.topics import decoded, monitor_topic
from gcs.relay.states import ReceiverState
from gcs.replay.run import RunReplay
from gcs.replay.screen import RecordedScreen, watch
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.status import RunStatus
from gcs.traced_monitor import MonitorNote
from tests.gcs.replay.legs import KEYS, Said, fly_run, write_run

SAID = fly_run()
ROOT = Path(__file__).parents[3]


def replayed(folder: Path, **changes: float) -> RunReplay:
    run = RunReplay(folder, changes)
    for _ in run.messages():
        pass
    return run


def exit_status(folder: Path, speed: float | None = None, settings: list[str] | None = None) -> int:
    try:
        replay(folder, speed, settings)
    except typer.Exit as ended:
        return int(ended.exit_code)
    return 0


def test_the_command_shows_every_stop_beside_its_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status(write_run(tmp_path, SAID)) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [line.split() for line in lines if line.startswith("U1")]
    assert [row[1:4] for row in rows] == [["turn", "away", "L0"], ["slot", "towards", "L1"], ["trim", "towards", "L1"]]
    assert [row[-1] for row in rows] == ["identical"] * 3
    for row in rows:
        assert row[4:7] == row[7:10]
        assert float(row[4]) > 10.0
    assert "3 of 3 flights decided as recorded" in lines[-1]
    assert "differ by 0 m" in lines[-1]


def test_a_changed_setting_shows_what_it_would_have_decided(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status(write_run(tmp_path, SAID), settings=["monitor.slot.dwell_s=2.5"]) == 0
    turn, slot, _ = (line for line in capsys.readouterr().out.splitlines() if line.startswith("U1"))
    assert turn.split()[-1] == "identical"
    assert 1.3 < float(slot.split()[-2]) < 1.7


def test_another_process_decides_the_same(tmp_path: Path) -> None:
    """Nothing hangs on the order of sets, which is another there."""
    write_run(tmp_path, SAID)
    script = f"from pathlib import Path; from gcs.commands.replay import replay; replay(Path({str(tmp_path)!r}))"
    environment = {**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, env=environment, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "3 of 3 flights decided as recorded" in done.stdout
    assert "places differ by 0 m" in done.stdout


def test_the_recording_opens_with_the_reader_of_its_makers_and_keeps_its_promises(tmp_path: Path) -> None:
    """All that a recording of a run holds: read by index, too, and every message against its schema."""
    jsonschema = pytest.importorskip("jsonschema")
    write_run(tmp_path, SAID)
    with (tmp_path / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics.message_count == len(SAID)
        assert {channel.topic for channel in summary.channels.values()} == {topic for _, topic, _ in SAID}
        for schema in summary.schemas.values():
            jsonschema.Draft202012Validator.check_schema(json.loads(schema.data))
        validators = {
            number: jsonschema.Draft202012Validator(json.loads(schema.data))
            for number, schema in summary.schemas.items()
        }
        for schema, _, message in reader.iter_messages():
            validators[schema.id].validate(json.loads(message.data))


def forged(said: list[Said]) -> list[Said]:
    """Return a recording in which the turn was decided at its 21st question."""
    asked = 0
    result = []
    for time_ns, topic, payload in said:
        note = decoded(payload, topic)
        if isinstance(note, MonitorNote) and note.asked is not None:
            asked += 1
            forgery = payload.replace(b'"arrived":false', b'"arrived":true') if asked == 21 else payload
            result.append((time_ns, topic, forgery))
        else:
            result.append((time_ns, topic, payload))
    return result


def test_a_decision_that_does_not_come_out_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status(write_run(tmp_path, forged(SAID))) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "2 of 3 flights decided as recorded" in told
    assert "sample" in told


def test_a_report_that_was_never_on_the_bus_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heard = [index for index, (_, topic, _) in enumerate(SAID) if topic == KEYS.bearings("U1")]
    said = [message for index, message in enumerate(SAID) if index not in heard[10:13]]
    assert exit_status(write_run(tmp_path, said)) == 1
    assert "3 reports that monitors took in are not on the recorded bus" in capsys.readouterr().out


def test_a_report_that_was_changed_on_the_bus_is_said(tmp_path: Path) -> None:
    index = [index for index, (_, topic, _) in enumerate(SAID) if topic == KEYS.bearings("U1")][10]
    time_ns, topic, payload = SAID[index]
    report = decoded(payload, topic)
    assert isinstance(report, BearingReport)
    report.bearings[0] = type(report.bearings[0])("L0", report.bearings[0].azimuth_rad + 1e-12, 0.003)
    run = replayed(write_run(tmp_path, [*SAID[:index], (time_ns, topic, encode(report)), *SAID[index + 1 :]]))
    assert run.audit.unsaid == 1
    assert not run.sound


def test_a_service_that_was_killed_leaves_its_decisions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_run(tmp_path, SAID) / "flight.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert exit_status(tmp_path) == 1
    told = capsys.readouterr().out
    assert "flight.mcap" in told
    assert "after" in told
    assert "mcap recover" in told
    assert "turn away L0" in told
    assert replayed(tmp_path).flights[0].identical


def test_parts_of_a_recording_are_one_run(tmp_path: Path) -> None:
    run = replayed(write_run(tmp_path, SAID, SizeLimits(part_bytes=8_000)))
    assert (tmp_path / "flight-2.mcap").exists()
    assert run.sound
    assert len(run.flights) == 3


def test_a_recording_that_begins_in_flight_vouches_for_nothing(tmp_path: Path) -> None:
    run = replayed(write_run(tmp_path, SAID[len(SAID) // 2 :]))
    assert run.flights == []
    assert run.complaints == ["U1: how its first stop monitor was made is not in the recording"]


def test_a_run_without_notes_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    without = [message for message in SAID if message[1] != monitor_topic("U1")]
    assert exit_status(write_run(tmp_path, without)) == 1
    assert "no stop monitor is in the recording" in capsys.readouterr().out


def test_notes_that_make_no_sense_are_no_traceback(tmp_path: Path) -> None:
    """A guide that stands nowhere, a leg without length, numbers out of every range."""
    made = next(decoded(payload, topic) for _, topic, payload in SAID if b'"made"' in payload)
    for old, new in (
        (b'"guide":"L0"', b'"guide":"nobody"'),
        (b'"dwell_s":', b'"sway_m":1e400,"dwell_s":'),
        (b'"start_m":[30.0,40.0]', b'"start_m":[1e308,-1e308]'),
    ):
        assert old in encode(made)
        said = [(time_ns, topic, payload.replace(old, new)) for time_ns, topic, payload in SAID]
        run = replayed(write_run(tmp_path, said))
        assert not run.sound
        (tmp_path / "flight.mcap").unlink()


@pytest.mark.parametrize("name", ["playbook.json", "run.json"])
def test_a_folder_that_is_no_run_s_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(ServiceError, match=r"playbook\.json cannot be read"):
        RunReplay(tmp_path, {})
    (write_run(tmp_path, SAID[:5]) / name).write_text("[]")
    with pytest.raises(ServiceError, match=name):
        RunReplay(tmp_path, {})


def test_a_plan_that_is_none_is_named_before_the_screen_opens(tmp_path: Path) -> None:
    (write_run(tmp_path, SAID) / "plan.json").write_text("{}")
    with pytest.raises(ServiceError, match=r"plan\.json is not a plan"):
        RunReplay(tmp_path, {}).records()


def test_the_screen_shows_the_run_as_it_went(tmp_path: Path) -> None:
    run = RunReplay(write_run(tmp_path, SAID), {})
    rows: list[list[str]] = []

    async def show() -> None:
        status = RunStatus(run.name, VirtualClock(), records=run.records())
        screen = RecordedScreen(status, run.monitors)
        for number, (message, said) in enumerate(run.messages()):
            screen.take(message.topic, said)
            if number % 20 == 0:
                view = io.StringIO()
                Console(file=view, width=100).print(progress_view(status))
                head, _, row, *_ = view.getvalue().splitlines()
                rows.append([*row.split(), *head.partition("on the air: ")[2].split(", ")])
        assert status.records["U1"].state is ReceiverState.PLACED
        assert status.on_air == {"L0"}
        assert [text for _, text in status.messages][:2] == ["U1 LOCATING", "U1 LEG_1"]

    run_virtually(show())
    turn = [row for row in rows if row[2] == "LEG_1" and "away" in row]
    angles_deg, to_go_m = [[float(row[column]) for row in turn] for column in (5, 7)]
    assert to_go_m[0] > 10.0
    assert to_go_m[-1] < 1.0
    assert angles_deg[-1] == pytest.approx(float(turn[-1][6]), abs=2.0)
    assert turn[0][-2:] == ["L0", "L1"]


def test_the_run_is_shown_at_its_own_speed(tmp_path: Path) -> None:
    run = RunReplay(write_run(tmp_path, SAID), {})
    output = io.StringIO()

    async def show() -> float:
        clock = VirtualClock()
        await watch(run, clock, Console(file=output, width=100))
        return clock.now_s()

    lasted_s = run_virtually(show())
    assert lasted_s == pytest.approx((SAID[-1][0] - SAID[0][0]) * 1e-9, abs=0.01)
    lines = output.getvalue().splitlines()
    assert lines[0].split() == ["10.0", "s", "U1", "LOCATING"]
    assert lines[-1].split()[-1] == "PLACED"
    assert run.sound


def test_a_recording_without_messages_shows_nothing(tmp_path: Path) -> None:
    (write_run(tmp_path, SAID[:1]) / "flight.mcap").write_bytes(b"")
    run = RunReplay(tmp_path, {})
    run_virtually(watch(run, VirtualClock(), Console(file=io.StringIO())))
    assert len(run.complaints) == 1
