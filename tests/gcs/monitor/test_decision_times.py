"""Decisions are counted by how old the bearings are that they were taken on."""

from __future__ import annotations

import pytest

from gcs.monitor.decision_times import BOUNDS_S, DecisionTimes
from gcs.traced_monitor import Asked, MonitorNote, Observed
from tests.fakes import ManualClock

OBSERVED = Observed({}, {}, [])
ASKED = Asked((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.1, arrived=False)


def test_a_decision_is_as_old_as_the_bearings_of_that_receiver() -> None:
    clock = ManualClock()
    times = DecisionTimes(clock)
    for receiver, age_s in (("U1", 0.06), ("U2", 0.004), ("U1", 5.0)):
        times.note(receiver, MonitorNote(0, clock.now_s() - age_s, observed=OBSERVED))
    times.note("U1", MonitorNote(1, clock.now_s(), asked=ASKED))
    times.note("U2", MonitorNote(1, clock.now_s(), asked=ASKED))
    told = times.histogram()
    assert told.bounds_s == list(BOUNDS_S)
    assert (told.counts[0], told.counts[-2], told.counts[-1]) == (1, 1, 2)
    assert told.sum_s == pytest.approx(5.004)


def test_a_decision_without_new_bearings_is_none() -> None:
    times = DecisionTimes(ManualClock())
    times.note("U1", MonitorNote(0, 1.0, asked=ASKED))
    times.note("U1", MonitorNote(1, 1.0, begun=True))
    assert times.histogram().counts[-1] == 0
