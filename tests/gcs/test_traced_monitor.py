"""A traced stop monitor decides as any other, and its notes are enough to make it decide so again, to the last bit."""

from __future__ import annotations

import cmath
import json
from dataclasses import fields

import jsonschema
import msgspec
import numpy as np
import pytest

from drivers.bus.messages import encode
from gcs.recording.topics import decoded, monitor_topic, schema_of
from gcs.relay.leg_filter import Whereabouts
from gcs.stop_monitor import SLOT, StopMonitor
from gcs.traced_monitor import Asked, MonitorNote, SetUp, TracedMonitor
from tests.gcs.replay.legs import LEGS, PLACES, fly_run

NOTES = [decoded(payload, topic) for _, topic, payload in fly_run() if topic == monitor_topic("U1")]


MADE_OF = {field.name for field in fields(StopMonitor) if field.init} - {"outliers", "stuck"}
"""Everything a monitor begins with; the two others it finds out."""


def test_everything_a_monitor_is_made_of_is_told() -> None:
    """Whoever gives the monitor something new to be made of has to tell it too."""
    otherwise = {"leg", "transmitters", "start", "start_covariance", "time_s"}
    assert MADE_OF - otherwise <= set(SetUp.__struct_fields__)


def test_a_monitor_is_made_again_from_its_note() -> None:
    notes: list[MonitorNote] = []
    covariance = np.array([[0.31, 0.1 / 3.0], [0.1 / 3.0, 0.7]])
    monitor = TracedMonitor(
        LEGS[1], PLACES, 1 / 3 - 0.1j, covariance, 7.1, SLOT, {"U7": 0.1}, heading_referenced=False, tell=notes.append
    )
    (note,) = notes
    again = decoded(encode(note), monitor_topic("U1")).made.monitor(note.time_s)
    for name in MADE_OF - {"start_covariance"}:
        assert getattr(again, name) == getattr(monitor, name), name
    assert np.array_equal(again.start_covariance, covariance)


def test_tracing_changes_no_decision_and_notes_bring_the_last_bit() -> None:
    monitor, asked, stops = None, 0, 0
    for note in NOTES:
        if note.made is not None:
            monitor = note.made.monitor(note.time_s)
        assert monitor is not None
        if note.begun:
            monitor.begin(note.time_s)
        if note.observed is not None:
            agreeing = monitor.observe(note.time_s, note.observed.directions_rad, note.observed.sigma_rad)
            assert sorted(agreeing) == note.observed.agreeing
        if note.commanded_mps is not None:
            monitor.commanded(note.time_s, complex(*note.commanded_mps))
        if note.asked is not None:
            now = monitor.whereabouts(note.time_s)
            assert Asked.of(now, arrived=monitor.arrived(now)) == note.asked
            asked += 1
            stops += note.asked.arrived
    assert stops == 3
    assert asked > 100


def test_notes_are_numbered_from_each_monitor_s_making() -> None:
    numbers = [note.number for note in NOTES]
    makings = [index for index, note in enumerate(NOTES) if note.made is not None]
    assert makings[0] == 0
    assert len(makings) == 2
    assert numbers == [*range(makings[1]), *range(len(NOTES) - makings[1])]


def test_every_kind_of_note_is_what_the_schema_promises() -> None:
    schema = json.loads(schema_of(MonitorNote))
    jsonschema.Draft202012Validator.check_schema(schema)
    kinds = ("made", "begun", "observed", "asked", "commanded_mps")
    seen = {}
    for note in NOTES:
        plain = json.loads(encode(note))
        seen |= {kind: plain for kind in kinds if kind in plain}
    assert set(seen) == set(kinds)
    for plain in seen.values():
        jsonschema.validate(plain, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(seen["asked"] | {"asked": {"arrived": "yes"}}, schema)


def test_numbers_of_any_kind_are_told_exactly() -> None:
    """A mean by numpy is a float of another kind, which JSON encoders refuse."""
    notes: list[MonitorNote] = []
    numbers = np.array([0.1 + 0.2, 2.0])
    monitor = TracedMonitor(LEGS[0], PLACES, 30 + 40j, np.eye(2), np.float64(7.0), SLOT, tell=notes.append)
    monitor.observe(np.float64(7.1), dict(zip(PLACES, numbers, strict=False)), dict.fromkeys(PLACES, np.float64(0.1)))
    told = decoded(encode(notes[-1]), monitor_topic("U1"))
    assert told.time_s == 7.1
    assert list(told.observed.directions_rad.values()) == [0.1 + 0.2, 2.0]


def test_a_note_that_cannot_be_taken_is_said_once_and_the_monitor_decides_on(caplog: pytest.LogCaptureFixture) -> None:
    def fail(note: MonitorNote) -> None:
        raise OSError("no room")

    monitor = TracedMonitor(LEGS[0], PLACES, LEGS[0].end, np.eye(2) * 1e-4, 7.0, SLOT, tell=fail)
    monitor.begin(7.0)
    directions = {name: cmath.phase(at - LEGS[0].end) for name, at in PLACES.items()}
    decided = []
    for tick in range(1, 30):
        assert monitor.observe(7.0 + tick / 10, directions, dict.fromkeys(PLACES, 0.001)) == PLACES.keys()
        decided.append(monitor.arrived(monitor.whereabouts(7.0 + tick / 10)))
    assert decided[-1]
    assert [record.getMessage() for record in caplog.records] == [
        "what a stop monitor decides cannot be recorded; the flight goes on"
    ]


def test_a_number_that_json_does_not_have_is_no_note() -> None:
    """It shows in the recording, as unreadable, and as a gap in the numbers."""
    lost = Whereabouts(0.0, complex("nan"), 0j, 0j, 0j, 0.1, 0.1)
    payload = encode(MonitorNote(1, 0.0, asked=Asked.of(lost, arrived=False)))
    with pytest.raises(msgspec.ValidationError):
        decoded(payload, monitor_topic("U1"))


def test_what_directions_were_rounded_to_is_told_of_those_that_were() -> None:
    notes: list[MonitorNote] = []
    monitor = TracedMonitor(LEGS[0], PLACES, LEGS[0].start, np.eye(2), 7.0, SLOT, tell=notes.append)
    directions = {name: cmath.phase(at - LEGS[0].start) for name, at in PLACES.items()}
    monitor.observe(7.1, directions, dict.fromkeys(PLACES, 0.001))
    monitor.observe(7.2, directions, dict.fromkeys(PLACES, 0.001), 0.0175)
    plain, rounded = (json.loads(encode(note))["observed"] for note in notes[1:])
    assert "resolution_rad" not in plain
    assert rounded["resolution_rad"] == 0.0175
    assert decoded(encode(notes[2]), monitor_topic("U1")).observed == notes[2].observed
