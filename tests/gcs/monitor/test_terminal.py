"""The terminal shows who flies what, how far it has to go, and what is wrong."""

from __future__ import annotations

import asyncio
import io
import math
from dataclasses import dataclass, field, replace

import pytest
from rich.console import Console

from drivers.mavlink.link_status import LinkState, LinkStatus
from gcs.monitor.terminal import progress_view, result_lines, result_table, show_progress
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.states import ReceiverState
from gcs.status import RunStatus
from gcs.stop_monitor import LegEstimate
from planner.methods.paper import plan
from planner.relay import RelayProblem
from tests.fakes import ManualClock


@pytest.fixture
def status() -> RunStatus:
    relay = plan(RelayProblem({"L0": 0j, "L1": 100 + 0j}, {"U1": 40 + 70j}, {"O1": 70 + 60j}))
    clock = ManualClock()
    status = RunStatus("test", clock, phase="relay", on_air=frozenset({"L0", "L1"}))
    clock.jump(12.0)
    record = ReceiverRecord(relay.routes[0], ReceiverState.LEG_1)
    leg = LegRecord(relay.routes[0].legs[0], 0.0, estimate=LegEstimate(7.4, -0.6, 3.0, 0.2), measured_angle_rad=1.0)
    record.legs.append(leg)
    status.records = {"U1": record}
    return status


def shown(what: object, width: int = 100) -> str:
    console = Console(file=io.StringIO(), width=width, force_terminal=False)
    console.print(what)
    return console.file.getvalue()


def test_the_view_shows_the_leg_in_flight(status: RunStatus) -> None:
    status.say("U1 LEG_1: no bearing report from its sensor for 0.5 s: zero velocity")
    text = shown(progress_view(status))
    leg = status.records["U1"].legs[0].leg
    for words in (
        "test  relay  12 s  0/1 placed",
        "L0, L1",
        "U1",
        "O1",
        "LEG_1",
        f"{leg.direction} {leg.guide}",
        "57.30",
        "7.4",
        "-0.6",
        "zero velocity",
    ):
        assert words in text


def test_the_view_fits_80_columns(status: RunStatus) -> None:
    assert max(map(len, shown(progress_view(status), width=80).splitlines())) <= 80


@dataclass
class Relay:
    """A relay that waits for the operator."""

    held: str | None = "U1 was taken over: its mode was changed"
    waiting: bool = True
    taken: set[str] = field(default_factory=lambda: {"U1", "L0"})

    def ways_out(self) -> list[str]:
        return ["bearing-relay control release U1", "bearing-relay control abort"]


def test_who_is_held_or_its_pilots_is_shown_with_the_reason_and_the_way_out(status: RunStatus) -> None:
    route = status.records["U1"].route
    status.records = {
        "U1": ReceiverRecord(route, ReceiverState.PILOT, "its mode was changed"),
        "U2": ReceiverRecord(replace(route, receiver="U2"), ReceiverState.HELD, "U1 was taken over"),
        "U3": ReceiverRecord(replace(route, receiver="U3"), ReceiverState.HELD, "U1 was taken over"),
        "U4": ReceiverRecord(replace(route, receiver="U4"), ReceiverState.WAITING),
    }
    status.relay = Relay()
    lines = [line.strip() for line in shown(progress_view(status)).splitlines()]
    told = lines[lines.index(next(line for line in lines if line.startswith("ALERT"))) :]
    assert told == [
        "ALERT  relay: holds: U1 was taken over: its mode was changed",
        "→ bearing-relay control release U1 or bearing-relay control abort",
        "ALERT  U1: PILOT: its mode was changed",
        "→ give it back in its guided mode, then bearing-relay control release U1",
        "ALERT  U2, U3: HELD: U1 was taken over",
        "→ bearing-relay control resume",
        "ALERT  L0: its pilot has it: no longer trusted to stand",
        "→ bearing-relay control release L0",
    ]


def test_a_relay_that_flies_has_no_alerts(status: RunStatus) -> None:
    status.relay = Relay(held=None, waiting=False, taken=set())
    text = shown(progress_view(status))
    assert "ALERT" not in text
    assert "→" not in text


FINE = LinkStatus(
    address="udpin:127.0.0.1:14553",
    state=LinkState.UP,
    received=100,
    sent=50,
    lost=0,
    refused=0,
    dropped=0,
    skipped_bytes=0,
    loss_ratio=0.0,
    silent_for_s=0.1,
    heard_system_ids=(3,),
    contested_system_ids=(),
)


@pytest.mark.parametrize(
    ("link", "words"),
    [
        (FINE, None),
        (replace(FINE, loss_ratio=0.004, silent_for_s=0.4), None),
        (replace(FINE, loss_ratio=0.04, silent_for_s=0.8), "4 % lost, silent 0.8 s"),
        (replace(FINE, state=LinkState.SILENT, silent_for_s=7.0), "silent 7.0 s"),
        (replace(FINE, state=LinkState.DOWN, silent_for_s=2.0), "down, tried again, silent 2.0 s"),
        (
            replace(FINE, state=LinkState.CONNECTING, loss_ratio=None, silent_for_s=math.inf),
            "nothing heard yet",
        ),
        (replace(FINE, contested_system_ids=(3,)), "two autopilots with system id 3"),
    ],
)
def test_a_link_is_shown_only_when_it_is_not_fine(status: RunStatus, link: LinkStatus, words: str | None) -> None:
    status.links = lambda: [("U3", link)]
    text = shown(progress_view(status))
    assert f"U3: udpin:127.0.0.1:14553: {words}" in text if words else "U3" not in text


def test_between_legs_and_with_nobody_on_the_air(status: RunStatus) -> None:
    status.on_air = frozenset()
    status.records["U1"].legs[0].ended_s = 3.0
    text = shown(progress_view(status))
    assert "nobody" in text
    assert "7.4" not in text


async def test_without_a_terminal_every_message_is_a_line_once(status: RunStatus) -> None:
    console = Console(file=io.StringIO(), width=100)
    status.say("first")
    screen = asyncio.create_task(show_progress(console, status))
    await asyncio.sleep(0)
    status.say("second")
    screen.cancel()
    with pytest.raises(asyncio.CancelledError):
        await screen
    assert console.file.getvalue().splitlines() == ["   12.0 s  first", "   12.0 s  second"]


async def test_a_long_run_s_last_messages_are_printed_too(status: RunStatus) -> None:
    console = Console(file=io.StringIO(), width=100)
    for number in range(500):
        status.say(f"old {number}")
    screen = asyncio.create_task(show_progress(console, status))
    await asyncio.sleep(0)
    status.say("new")
    screen.cancel()
    with pytest.raises(asyncio.CancelledError):
        await screen
    assert [line.split("s  ")[1] for line in console.file.getvalue().splitlines()[-2:]] == ["old 499", "new"]


async def test_on_a_terminal_the_view_is_live_and_leaves_nothing_behind(status: RunStatus) -> None:
    console = Console(file=io.StringIO(), width=100, force_terminal=True)
    screen = asyncio.create_task(show_progress(console, status))
    for _ in range(3):
        await asyncio.sleep(0)
    assert "LEG_1" in console.file.getvalue()
    screen.cancel()
    with pytest.raises(asyncio.CancelledError):
        await screen


REPORT = {
    "playbook": "test",
    "outcome": "aborted",
    "planned_total_length_m": 100.0,
    "flown_total_length_m": 50.0,
    "straight_line_bound_m": 80.0,
    "min_separation_m": None,
    "duration_s": 61.0,
    "emission_transmitter_s": 122.0,
    "bearing_reports": {"received": 500, "stale": 3, "out_of_order": 0, "malformed": 0, "unknown_sender": 0},
    "receivers": [
        {
            "name": "U1", "slot": "O1", "state": "HELD", "route_model": "I", "placement_error_m": None,
            "legs": [
                {"planned_length_m": 60.0, "flown_length_m": 50.0, "stop_angle_error_deg": -0.25},
                {"planned_length_m": 40.0, "flown_length_m": None, "stop_angle_error_deg": None},
            ],
        }
    ],
}  # fmt: skip


def test_the_result_table_and_its_totals() -> None:
    table = shown(result_table(REPORT))
    for words in ("test: aborted", "HELD", "100.00", "50.00", "-0.250"):
        assert words in table
    lines = "\n".join(result_lines(REPORT))
    assert "planned 100.00 m, flown 50.00 m (straight lines: 80.00 m)" in lines
    assert "500 bearing reports (3 stale)" in lines
    assert "closest approach –" in lines
