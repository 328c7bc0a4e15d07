"""How far a run had come, from its journal; and what the relay goes on from."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gcs.recording.journal import change_line, relay_line
from gcs.recording.journal_reading import Change, entries_of
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import IN_FLIGHT, ReceiverState
from gcs.resume.state import Restored, restored, run_state
from tests.gcs.resume.killed import PLAN

S = ReceiverState


def record(name: str, state: ReceiverState, reason: str = "") -> ReceiverRecord:
    return ReceiverRecord(
        PLAN.route_of(name), state, reason, place=3 + 4j, covariance=np.array([[0.04, 0.01], [0.01, 0.09]])
    )


def line(name: str, state: ReceiverState, reason: str = "") -> bytes:
    return json.dumps(change_line(1, record(name, state, reason))).encode()


def said(taken: tuple[str, ...] = (), given_up: tuple[str, ...] = ()) -> bytes:
    return json.dumps(relay_line(1, "words", taken, given_up)).encode()


def after(*lines: bytes, without: dict[str, str] | None = None) -> Restored:
    return restored(PLAN, run_state(entries_of(lines).entries), without or {})


def test_an_entry_comes_back_as_it_was_written() -> None:
    told = record("U3", S.PLACED, "bearings put it 0.1 m from O3")
    (entry,) = entries_of([json.dumps(change_line(17, told)).encode()]).entries
    assert isinstance(entry, Change)
    assert (entry.time_ns, entry.receiver, entry.state, entry.reason) == (17, "U3", S.PLACED, told.reason)
    assert entry.place == told.place
    assert entry.covariance is not None
    assert entry.covariance.tolist() == told.covariance.tolist()
    assert entry.route is not None
    assert entry.route.transmitters == told.route.transmitters
    assert [leg.end for leg in entry.route.legs] == [leg.end for leg in told.route.legs]


@pytest.mark.parametrize("length", range(0, 200, 7))
def test_a_line_cut_off_anywhere_is_lost_and_said_and_nothing_else_is(length: int) -> None:
    whole = line("U1", S.PLACED)
    read = entries_of([line("U1", S.LEG_1), whole[:length], line("U2", S.LEG_1)])
    assert [(entry.receiver, entry.state) for entry in read.entries] == [("U1", S.LEG_1), ("U2", S.LEG_1)]
    assert [lost.number for lost in read.lost] == [2]
    assert str(read.lost[0]).startswith("line 2 is not whole and was lost")


@pytest.mark.parametrize(
    "text",
    [
        b"\xff\xfe", b"null", b"[]", b"{}", b'{"time_ns": 1}', b'{"time_ns": "now", "relay": "x"}',
        b'{"time_ns": 1, "receiver": "U1", "state": "DANCING"}', b'{"time_ns": 1, "receiver": "U1"}',
        b'{"time_ns": 1, "receiver": "U1", "state": "PLACED", "known": {"place_m": [1]}}',
    ],
)  # fmt: skip
def test_what_is_no_entry_is_lost_and_said(text: bytes) -> None:
    read = entries_of([text, line("U1", S.LEG_1)])
    assert (len(read.entries), len(read.lost)) == (1, 1)


def test_a_route_that_is_none_is_done_without() -> None:
    (entry,) = entries_of(
        [b'{"time_ns": 1, "receiver": "U1", "state": "HELD", "known": {"route": {"slot": 3}}}']
    ).entries
    assert isinstance(entry, Change)
    assert entry.route is None


def test_a_covariance_that_is_not_finite_says_nothing() -> None:
    odd = record("U1", S.LEG_1)
    odd.covariance = np.array([[np.inf, 0.0], [0.0, np.nan]])
    assert change_line(1, odd)["known"]["covariance_m2"] is None


def test_an_empty_journal_is_a_run_that_has_not_begun() -> None:
    begun = after()
    assert {at.state for at in begun.records.values()} == {S.WAITING}
    assert (begun.unverified, begun.changed) == ((), ())


def test_those_that_stood_are_verified_in_the_order_in_which_they_came_to_stand() -> None:
    begun = after(line("U2", S.PLACED), line("U1", S.PLACED), line("U2", S.HELD), line("U2", S.PLACED))
    assert begun.unverified == ("U1", "U2")
    assert {begun.records[name].state for name in ("U1", "U2")} == {S.PLACED}
    assert begun.records["U1"].place == 3 + 4j
    assert begun.changed == ()


@pytest.mark.parametrize("state", sorted(IN_FLIGHT, key=lambda state: state.value))
def test_who_was_on_its_way_is_held_and_may_be_anywhere(state: ReceiverState) -> None:
    begun = after(line("U1", S.PLACED), line("U2", state))
    held = begun.records["U2"]
    assert (held.state, held.off_plan, held.strayed) == (S.HELD, True, True)
    assert held.reason == f"the service ended while it was in {state.value}"
    assert begun.unverified == ("U1", "U2")
    assert begun.changed == ("U2",)


def test_who_was_held_keeps_its_reason() -> None:
    begun = after(line("U2", S.HELD, "its sensor is silent"))
    assert begun.records["U2"].reason == "its sensor is silent"
    assert begun.changed == ()


def test_a_pilot_s_vehicle_is_withheld_until_it_is_given_up() -> None:
    assert after(line("U2", S.PILOT), said(taken=("L1", "U2"))).withheld == {"L1", "U2"}
    assert after(line("U2", S.PILOT)).withheld == {"U2"}, "the service ended before it could say more"
    assert after(line("U2", S.PILOT), line("U2", S.HELD), said()).withheld == frozenset()
    assert after(line("U2", S.PILOT), said(taken=("U2",), given_up=("U2",))).withheld == frozenset()


def test_what_is_said_where_there_is_no_relay_leaves_what_was_known() -> None:
    words = json.dumps(relay_line(2, "stage", None, None)).encode()
    assert after(said(taken=("U2",), given_up=("L1",)), words).withheld == {"U2"}
    assert after(said(taken=("U2",), given_up=("L1",)), words).given_up == {"L1"}


def test_who_was_given_up_or_is_done_without_is_failed_and_not_looked_for() -> None:
    begun = after(
        line("U1", S.PLACED), line("U2", S.FAILED, "skipped"), said(given_up=("L1", "U2")), without={"U1": "gone"}
    )
    assert begun.given_up == {"L1", "U1", "U2"}
    assert (begun.records["U1"].state, begun.records["U1"].reason) == (S.FAILED, "gone")
    assert (begun.records["U2"].state, begun.records["U2"].reason) == (S.FAILED, "skipped")
    assert begun.unverified == ()
    assert begun.changed == ("U1",)
