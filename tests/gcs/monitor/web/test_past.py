"""What a page that comes late is told of the past."""

import json

import msgspec
import pytest

from gcs.monitor.client import RunClient
from gcs.monitor.web.past import past_of
from tests.gcs.monitor.web.scripted import ScriptedRun, setup_of


def client_of(run, states):
    client = RunClient(find=lambda: None)
    for _ in range(states):
        client.state = run.advance(0.2)
        client.history.take(client.state)
    client.events.extend(run.events)
    return client


def test_a_page_that_comes_late_gets_tracks_events_and_the_angles_of_the_leg_flown_last():
    run = ScriptedRun(setup_of())
    client = client_of(run, 50)
    past = json.loads(msgspec.json.encode(past_of(client)))
    receiver = next(one for one in client.state.receivers if one.name == "U1")
    assert past["run"] == run.setup.run
    assert len(past["tracks"]["U1"]) > 10
    angles = past["angles"]["U1"]
    assert angles["number"] == receiver.leg.number == 2
    assert angles["samples"][-1] == pytest.approx([client.state.elapsed_s, receiver.leg.angle_rad])
    assert len(angles["samples"]) < len(client.history.angles["U1"])
    assert [state for _, state in past["spans"]["U1"]] == ["LOCATING", "LEG_1", "LEG_2"]
    assert past["spans"]["U2"] == [[pytest.approx(0.2), "WAITING"]]
    assert [event["number"] for event in past["events"]] == list(range(len(run.events)))


def test_before_a_run_is_heard_of_there_is_no_past():
    past = past_of(RunClient(find=lambda: None))
    assert (past.run, past.tracks, past.angles, past.spans, past.events) == (None, {}, {}, {}, [])
