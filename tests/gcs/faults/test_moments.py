"""Each fault begins once, so long after its receiver first came into a state, and ends once."""

from __future__ import annotations

from gcs.faults.fault import Fault, Moment
from gcs.faults.moments import Moments

SILENT = Fault("sensor_silent", "U1", Moment("U1", "LEG_1", 2.0), 3.0)
DRIFTS = Fault("transmitter_drift", "L0", Moment("U1", "LEG_1", 1.0), None)
KILLED = Fault("service_killed", "U1", Moment("U1", "LEG_1", 4.0), None)
STOPPED = Fault("service_stopped", "U1", Moment("U1", "LEG_1", 1.0), 1.0)


def told(moments: Moments, *, ended: bool = False) -> list[tuple[float, str, bool]]:
    return [
        (at_s, fault.kind, begins)
        for at_s in (10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0)
        for fault, begins in moments.due(at_s, ended=ended)
    ]


def test_nothing_fails_before_its_state_has_come() -> None:
    moments = Moments([SILENT])
    moments.entered("U2", "LEG_1", 0.0)
    moments.entered("U1", "LEG_2", 0.0)
    assert told(moments) == []


def test_each_begins_once_and_ends_once_and_one_for_ever_does_not_end() -> None:
    moments = Moments([SILENT, DRIFTS])
    moments.entered("U1", "LEG_1", 10.0)
    moments.entered("U1", "LEG_1", 13.0)
    assert moments.astray() == set()
    assert told(moments) == [
        (11.0, "transmitter_drift", True),
        (12.0, "sensor_silent", True),
        (15.0, "sensor_silent", False),
    ]
    assert moments.struck == {0: 12.0, 1: 11.0}
    assert moments.astray() == {"L0"}


def test_what_befalls_the_service_ends_by_itself_and_befalls_none_that_has_ended() -> None:
    moments, later = Moments([KILLED, STOPPED]), Moments([KILLED, STOPPED])
    for each in (moments, later):
        each.entered("U1", "LEG_1", 10.0)
    assert told(moments) == [(11.0, "service_stopped", True), (14.0, "service_killed", True)]
    assert told(later, ended=True) == []
    assert later.struck == {}
