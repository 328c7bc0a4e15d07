"""What a flight of embedded copters leaves behind: decisions that come out again, and files that other tools open."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil

from gcs.recording.topics import monitor_topic
from gcs.replay.run import RunReplay
from tests.gcs.simulate.small import small_text

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fly one receiver and return the folder of its run."""
    folder = tmp_path_factory.mktemp("flight")
    (folder / "small.yaml").write_text(small_text("sensor: {sigma_deg: 0.3}\n"), encoding="utf-8")
    command = ["fly", str(folder / "small.yaml"), "--speedup", "5", "--runs-dir", str(folder / "runs")]
    flown = subprocess.run(
        [sys.executable, "-m", "gcs.cli", *command], capture_output=True, text=True, timeout=120, check=False, cwd=ROOT
    )
    assert flown.returncode == 0, flown.stdout + flown.stderr
    return next((folder / "runs").iterdir())


def test_every_decision_of_a_flight_comes_out(run: Path) -> None:
    replay = RunReplay(run, {})
    topics = {message.topic for message, _ in replay.messages()}
    assert monitor_topic("U1") in topics
    assert replay.sound, (replay.complaints, replay.audit.unsaid, [flight.difference for flight in replay.flights])
    for flight in replay.flights:
        assert flight.recorded == flight.replayed
        assert flight.largest_difference_m == 0.0
    decided = [flight.what for flight in replay.flights if flight.recorded is not None]
    assert len(decided) >= 2
    assert set(decided) == {flight.what for flight in replay.flights}, "a leg that this machine held up is begun anew"


def test_every_message_of_a_flight_is_what_its_schema_promises(run: Path) -> None:
    with (run / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        validators: dict[int, jsonschema.Draft202012Validator] = {}
        count = 0
        for schema, _, message in reader.iter_messages():
            count += 1
            if schema is None:
                continue
            if schema.id not in validators:
                form = json.loads(schema.data)
                jsonschema.Draft202012Validator.check_schema(form)
                validators[schema.id] = jsonschema.Draft202012Validator(form)
            if count % 5 == 0 or schema.name == "MonitorNote":
                validators[schema.id].validate(json.loads(message.data))
        assert count > 1_000
        assert len(validators) >= 5


def test_every_telemetry_log_of_a_flight_opens_with_pymavlink(run: Path) -> None:
    logs = sorted((run / "tlogs").glob("*.tlog"))
    assert logs
    kinds: set[str] = set()
    for path in logs:
        log = mavutil.mavlogfile(str(path), robust_parsing=False)
        try:
            found = [message.get_type() for message in iter(log.recv_msg, None)]
        finally:
            log.close()
        assert len(found) > 50
        kinds |= set(found)
    assert {"HEARTBEAT", "SET_POSITION_TARGET_LOCAL_NED"} <= kinds
    assert "BAD_DATA" not in kinds
