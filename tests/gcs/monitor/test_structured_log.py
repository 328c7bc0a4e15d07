"""The structured log holds what the run says and what the program logs, a JSON object a line."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from gcs.monitor.structured_log import FILE, structured_log
from gcs.status import RunStatus
from tests.fakes import ManualClock


def lines(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / FILE).read_text().splitlines()]


def test_what_is_said_has_the_fields_of_its_vehicle(tmp_path: Path) -> None:
    clock = ManualClock()
    status = RunStatus("test", clock)
    with structured_log(tmp_path, status):
        clock.jump(2.5)
        status.say("U1 LEG_2", vehicle="U1", leg=2, state="LEG_2")
        status.say("the relay holds", level="alert")
    status.say("afterwards")
    first, second = lines(tmp_path)
    assert {name: first[name] for name in first if name != "time"} == {
        "level": "INFO", "logger": "run", "message": "U1 LEG_2",
        "elapsed_s": 2.5, "vehicle": "U1", "leg": 2, "state": "LEG_2",
    }  # fmt: skip
    assert first["time"].endswith("Z")
    assert (second["level"], second["message"], "vehicle" in second) == ("ERROR", "the relay holds", False)


def test_what_the_program_logs_is_there_too_with_its_exception(tmp_path: Path) -> None:
    log = logging.getLogger("drivers.somewhere")
    with structured_log(tmp_path, RunStatus("test", ManualClock())):
        log.warning("%s is slow", "U3", extra={"vehicle": "U3", "leg": 1})
        try:
            raise ValueError("no such link")
        except ValueError:
            log.exception("failed")
    log.warning("afterwards")
    slow, failed = lines(tmp_path)
    assert (slow["level"], slow["logger"], slow["message"]) == ("WARNING", "drivers.somewhere", "U3 is slow")
    assert (slow["vehicle"], slow["leg"]) == ("U3", 1)
    assert "ValueError: no such link" in failed["exception"]


def test_what_cannot_be_written_as_json_ends_nothing(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(logging, "raiseExceptions", False)
    with structured_log(tmp_path, RunStatus("test", ManualClock())):
        logging.getLogger("gcs.x").warning("odd", extra={"vehicle": object()})
        logging.getLogger("gcs.x").warning("good")
    assert [line["message"] for line in lines(tmp_path)] == ["good"]
