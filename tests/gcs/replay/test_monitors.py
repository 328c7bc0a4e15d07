"""Replayed from its record every decision comes out the same; what is not the same, or changed, shows."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from gcs.recording.topics import decoded, monitor_topic
from gcs.replay.monitors import Flight, MonitorReplay
from gcs.replay.settings import read_changes
from gcs.traced_monitor import MonitorNote
from tests.gcs.replay.legs import fly_run

Note = tuple[int, MonitorNote]

NOTES: list[Note] = [
    (time_ns, decoded(payload, topic)) for time_ns, topic, payload in fly_run() if topic == monitor_topic("U1")
]


def replay(notes: list[Note], *settings: str) -> list[Flight]:
    """Return every flight of U1, replayed."""
    replays: list[MonitorReplay] = []
    for time_ns, note in notes:
        if note.made is not None:
            replays.append(MonitorReplay("U1", note.made, note.time_s, read_changes(settings)))
        else:
            replays[-1].take(note, time_ns)
    return [flight for each in replays for flight in each.flights]


def changed(alter: Callable[[MonitorNote], MonitorNote | None]) -> list[Note]:
    """Return the notes with each changed, or dropped."""
    return [(time_ns, new) for time_ns, note in NOTES if (new := alter(note)) is not None]


def test_every_stop_comes_out_at_its_sample() -> None:
    flights = replay(NOTES)
    assert [flight.what for flight in flights] == ["turn away L0", "slot towards L1", "trim towards L1"]
    for flight in flights:
        assert flight.identical, flight.difference
        assert flight.recorded is not None
        assert flight.recorded == flight.replayed
        assert flight.largest_difference_m == 0.0
        assert abs(flight.recorded.at_rest) < 1.0


def test_a_longer_dwell_stops_later_while_the_receiver_hovers() -> None:
    before, after = replay(NOTES)[1], replay(NOTES, "monitor.slot.dwell_s=2.5")[1]
    assert after.identical
    assert after.recorded == before.recorded
    assert after.recorded is not None
    assert after.replayed is not None
    assert (after.replayed.time_ns - after.recorded.time_ns) * 1e-9 == pytest.approx(1.5, abs=0.15)


def test_a_wider_band_stops_earlier_and_farther_off() -> None:
    flights = replay(NOTES, "monitor.turn.band_m=3", "monitor.turn.sway_m=3")
    (turn, slot, trim) = flights
    assert turn.recorded is not None
    assert turn.replayed is not None
    assert turn.replayed.time_ns < turn.recorded.time_ns
    assert -3.5 < turn.replayed.at_rest.real < turn.recorded.at_rest.real - 0.5
    assert [flight.recorded == flight.replayed for flight in (slot, trim)] == [True, True]
    assert all(flight.identical for flight in flights)


def test_a_band_too_narrow_never_stops_and_says_where_the_receiver_was() -> None:
    turn = replay(NOTES, "monitor.turn.band_m=0.000001", "monitor.turn.widest_m=0.000001", "monitor.turn.dwell_s=100")[
        0
    ]
    assert turn.identical
    assert turn.replayed is None
    assert turn.recorded is not None
    assert turn.last_at_rest == turn.recorded.at_rest


def test_a_decision_that_was_not_the_monitor_s_is_found_at_its_sample() -> None:
    asked = [note for _, note in NOTES if note.asked is not None]
    victim, sample = asked[20], 21  # every report here was good, and asked about

    def forge(note: MonitorNote) -> MonitorNote:
        if note is not victim or note.asked is None:
            return note
        return msgspec.structs.replace(note, asked=msgspec.structs.replace(note.asked, arrived=True))

    turn, *others = replay(changed(forge))
    assert turn.difference == f"sample {sample}: no stop, recorded stop"
    assert turn.recorded is not None
    assert turn.recorded.sample == sample
    assert all(flight.identical for flight in others)


def test_a_direction_that_was_not_measured_is_found() -> None:
    observed = [note for _, note in NOTES if note.observed is not None][30]

    def forge(note: MonitorNote) -> MonitorNote:
        if note is not observed or note.observed is None:
            return note
        directions = note.observed.directions_rad | {"L0": note.observed.directions_rad["L0"] + 0.5}
        return msgspec.structs.replace(note, observed=msgspec.structs.replace(note.observed, directions_rad=directions))

    turn = replay(changed(forge))[0]
    assert turn.difference is not None
    assert "agree, recorded L0, L1, U7" in turn.difference


@pytest.mark.parametrize("lost", ["observed", "asked", "commanded_mps", "begun"])
def test_a_note_that_is_missing_is_found(lost: str) -> None:
    """Without it what follows proves nothing: it is not replayed."""
    notes = [note for _, note in NOTES if getattr(note, lost)]
    victim = notes[min(5, len(notes) - 1)]
    flights = replay(changed(lambda note: None if note is victim else note))
    broken = [flight for flight in flights if not flight.identical]
    assert len(broken) == 1
    assert f"note {victim.number + 1} follows note {victim.number - 1}" in str(broken[0].difference)


def test_a_leg_that_was_cut_off_has_no_stop_and_no_difference() -> None:
    """A held receiver, or a service that was killed: what was decided until then was still decided."""
    (turn,) = replay(NOTES[:50])
    assert turn.identical
    assert (turn.recorded, turn.replayed) == (None, None)
    assert turn.samples == 16
