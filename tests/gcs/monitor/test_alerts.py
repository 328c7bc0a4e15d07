"""What is wrong is told, the worst first, each with what to do about it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest

from drivers.bus.run_messages import Alert, RecordingHealth
from drivers.mavlink.link_status import LinkState, LinkStatus
from drivers.mavlink.telemetry import Battery
from gcs.monitor.state import StateTeller
from gcs.relay.states import ReceiverState
from tests.gcs.monitor.telling import ToldWorld, vehicle

FINE = LinkStatus("udpin:127.0.0.1:14553", LinkState.UP, 100, 50, 0, 0, 0, 0, 0.0, 0.1, (3,), ())


@dataclass
class Relay:
    held: str | None = None
    waiting: bool = False
    taken: set[str] = field(default_factory=set)

    def ways_out(self) -> list[str]:
        return ["bearing-relay control resume", "bearing-relay control abort"]


@pytest.fixture
def world() -> ToldWorld:
    world = ToldWorld(uavs=8)
    world.sources.vehicles = {name: vehicle(name, world.clock) for name in ("L0", "U1", "U2")}
    world.status.relay = Relay()
    world.measure()
    return world


def alerts(world: ToldWorld) -> list[Alert]:
    return StateTeller(world.sources).tell().alerts


def alert(world: ToldWorld) -> Alert:
    (only,) = alerts(world)
    return only


def test_nothing_while_all_is_well(world: ToldWorld) -> None:
    assert alerts(world) == []


def test_those_halted_alike_are_one_alert(world: ToldWorld) -> None:
    records = world.executor.records
    for name in ("U1", "U2"):
        records[name].state, records[name].reason = ReceiverState.HELD, "U3 was taken over"
    records["U3"].state, records["U3"].reason = ReceiverState.PILOT, "its mode was changed"
    records["U4"].state, records["U4"].reason = ReceiverState.FAILED, "given up by the operator"
    told = [(each.subject, each.text, each.way_out) for each in alerts(world)]
    assert told == [
        (
            "U3",
            "PILOT: its mode was changed",
            "give it back in its guided mode, then bearing-relay control release U3",
        ),
        ("U1, U2", "HELD: U3 was taken over", "bearing-relay control resume"),
        ("U4", "FAILED: given up by the operator", "it hovers: land it from another station"),
    ]


def test_those_whom_only_the_relay_holds_are_told_with_it(world: ToldWorld) -> None:
    for name in ("U1", "U2"):
        record = world.executor.records[name]
        record.state, record.reason = ReceiverState.HELD, "held by the operator"
    world.status.relay = Relay(held="held by the operator")
    assert (alert(world).subject, alert(world).text) == ("relay", "holds: held by the operator; stopped: U1, U2")


def test_when_the_run_has_ended_nobody_is_told_to_resume(world: ToldWorld) -> None:
    record = world.executor.records["U1"]
    record.state, record.reason = ReceiverState.HELD, "stopped by the operator"
    world.status.relay, world.status.phase = Relay(held="stopped by the operator"), "aborted"
    assert (alert(world).subject, alert(world).way_out) == ("U1", "it hovers: land it from another station")


def test_what_the_run_asks_is_answered_at_once(world: ToldWorld) -> None:
    world.status.asked = "locate failed, every vehicle holds; go on with the next stage?"
    assert (alert(world).subject, alert(world).way_out) == ("run", "bearing-relay control resume, or abort")
    assert StateTeller(world.sources).tell().asked == world.status.asked


def test_a_transmitter_its_pilot_has(world: ToldWorld) -> None:
    world.status.relay = Relay(taken={"L0"})
    told = alert(world)
    assert (told.level, told.subject, told.way_out) == ("alert", "L0", "bearing-relay control release L0")


def test_the_bus_that_is_gone(world: ToldWorld) -> None:
    world.sources.bus_connected = lambda: False
    assert (alert(world).level, alert(world).subject) == ("alert", "bus")


async def test_bearings_that_stay_away_from_a_receiver_in_flight(world: ToldWorld) -> None:
    world.on_air = {"L0", "L1"}
    world.measure()
    world.clock.jump(0.2)
    world.deliver()
    record = world.executor.records["U1"]
    record.state = ReceiverState.LEG_1
    for made in world.sources.vehicles.values():
        made.telemetry.last_message_s = world.clock.now_s() + 1.0
    world.clock.jump(0.7)
    assert (alert(world).level, alert(world).subject) == ("warning", "U1")
    assert "0.9 s old" in alert(world).text
    record.reason = "no bearing report from its sensor for 0.5 s: zero velocity"
    assert alert(world).text == record.reason
    record.state, record.reason = ReceiverState.WAITING, ""
    assert alerts(world) == []


@pytest.mark.parametrize(
    ("percent", "level"), [(None, None), (31, None), (30, "warning"), (16, "warning"), (15, "alert"), (0, "alert")]
)
def test_a_battery_that_runs_out(world: ToldWorld, percent: int | None, level: str | None) -> None:
    world.sources.vehicles["U2"].telemetry.battery = Battery(percent, None)
    assert [(each.level, each.subject) for each in alerts(world)] == ([] if level is None else [(level, "U2")])


@pytest.mark.parametrize(
    ("flags", "alarmed"), [(0, False), (0x33F, False), (0x3BF, True), (0x127, True), (0x833F, True)]
)
def test_a_poor_position_estimate(world: ToldWorld, flags: int, alarmed: bool) -> None:
    world.sources.vehicles["U1"].telemetry.estimator_flags = flags
    assert bool(alerts(world)) is alarmed


def test_a_silent_vehicle_is_worse_in_the_air(world: ToldWorld) -> None:
    world.clock.jump(0.6)
    for name in ("L0", "U2"):
        world.sources.vehicles[name].telemetry.last_message_s = world.clock.now_s()
    assert (alert(world).level, alert(world).text) == ("alert", "no telemetry for 0.6 s")
    heartbeat = world.sources.vehicles["U1"].telemetry.heartbeat
    world.sources.vehicles["U1"].telemetry.heartbeat = replace(heartbeat, armed=False)
    assert alert(world).level == "warning"


def test_two_that_are_too_near_are_one_alert(world: ToldWorld) -> None:
    board = world.score.board.latest
    least_m = 0.8 * world.playbook.planner.min_separation_m
    board["U2"] = replace(board["U1"], north_east=board["U1"].north_east + least_m + 0.1)
    assert alerts(world) == []
    board["U2"] = replace(board["U1"], north_east=board["U1"].north_east + least_m - 0.1)
    assert (alert(world).level, alert(world).subject) == ("alert", "U1")
    assert "from U2" in alert(world).text


@pytest.mark.parametrize(
    ("link", "level"),
    [
        (FINE, None),
        (replace(FINE, loss_ratio=0.04), "warning"),
        (replace(FINE, state=LinkState.DOWN), "alert"),
        (replace(FINE, state=LinkState.CONNECTING, silent_for_s=math.inf), "warning"),
        (replace(FINE, contested_system_ids=(3,)), "alert"),
    ],
)
def test_links(world: ToldWorld, link: LinkStatus, level: str | None) -> None:
    world.status.links = lambda: [("U1, U2", link)]
    told = StateTeller(world.sources).tell()
    assert [(each.level, each.subject) for each in told.alerts] == ([] if level is None else [(level, "U1, U2")])
    (health,) = told.links
    assert health.silent_s == (None if math.isinf(link.silent_for_s) else link.silent_for_s)
    assert (health.vehicles, health.loss, health.state) == ("U1, U2", link.loss_ratio, link.state.value)


def test_a_recording_that_has_stopped_and_misses_messages(world: ToldWorld) -> None:
    world.sources.recording = lambda: RecordingHealth("no space left", 7)
    world.status.recording = lambda: "no space left"
    assert [each.text for each in alerts(world)] == ["no space left", "7 messages are missing in flight.mcap"]


def test_the_worst_comes_first(world: ToldWorld) -> None:
    world.sources.recording = lambda: RecordingHealth("no space left")
    world.status.links = lambda: [("U1", replace(FINE, loss_ratio=0.5))]
    world.sources.vehicles["U1"].telemetry.battery = Battery(3, None)
    world.status.relay = Relay(held="held by the operator")
    assert [each.level for each in alerts(world)] == ["alert", "alert", "warning", "warning"]
    assert alerts(world)[0].way_out == "bearing-relay control resume or bearing-relay control abort"
