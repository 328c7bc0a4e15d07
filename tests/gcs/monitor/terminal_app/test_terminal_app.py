"""The terminal monitor shows the run at 80 columns and at 140, alerts first, and commands only where it may."""

from __future__ import annotations

import asyncio
import contextlib
import io
import math

import msgspec
import pytest
from rich.console import Console
from textual.widgets import Input, Static

from drivers.bus.messages import ControlReply, ControlRequest, encode
from drivers.bus.run_messages import Alert, LinkHealth, RunEvent, RunState
from drivers.errors import BusError
from gcs.monitor.client import LOST_S, RunClient
from gcs.monitor.history import AngleSample, Span
from gcs.monitor.state import StateTeller
from gcs.monitor.terminal_app import views
from gcs.monitor.terminal_app.angle_chart import angle_chart
from gcs.monitor.terminal_app.app import MonitorApp
from gcs.monitor.terminal_app.confirm import Confirm
from gcs.monitor.terminal_app.map_view import formation_map
from gcs.recording.bus_address import BusAddress
from gcs.relay.states import ReceiverState
from tests.fakes import ManualClock
from tests.gcs.monitor.telling import ToldWorld, vehicle

LINK = LinkHealth("U1", "udpin:127.0.0.1:59658", "up", 12345, 12345, 123, 0, 12, 0.012, 0.1)
SMALL, LARGE = (80, 24), (140, 40)
KEY = "bearing-relay/paper-8/relay/@state"


class Heard(RunClient):
    """A client that has heard a run, and answers the operator itself."""

    def __init__(self, world: ToldWorld) -> None:
        super().__init__(lambda: BusAddress("tcp/127.0.0.1:7447", "paper-8"), ManualClock())
        self.world = world
        self.asked: list[ControlRequest] = []
        self.reply: ControlReply | BusError = ControlReply(ok=True, message="it is done")
        self.setup = world.setup
        self.hear()

    def hear(self, **changes) -> None:
        state = msgspec.structs.replace(self.world.told, number=(self.state.number + 1 if self.state else 0), **changes)
        self._take_state(KEY, encode(state))

    async def command(self, request: ControlRequest) -> ControlReply:
        self.asked.append(request)
        if isinstance(self.reply, BusError):
            raise self.reply
        return self.reply


@pytest.fixture(scope="module")
def flown() -> ToldWorld:
    """A run whose first receiver is on its second leg."""

    async def fly() -> ToldWorld:
        world = ToldWorld()
        world.sources.vehicles = {name: vehicle(name, world.clock) for name in ("L0", "L1", *world.executor.records)}
        task = asyncio.create_task(world.executor.run())
        while world.executor.records["U1"].state is not ReceiverState.LEG_2:
            world._measure()
            await world.clock.advance(0.1)
        for _ in range(10):
            world._measure()
            await world.clock.advance(0.1)
        for made in world.sources.vehicles.values():
            made.telemetry.last_message_s = world.clock.now_s()
        world.told = StateTeller(world.sources).tell()
        task.cancel()
        return world

    return asyncio.run(fly())


@pytest.fixture
def client(flown: ToldWorld) -> Heard:
    return Heard(flown)


def lines(app: MonitorApp) -> list[str]:
    """Return what the terminal shows."""
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


def text(app: MonitorApp) -> str:
    return "\n".join(lines(app))


@contextlib.asynccontextmanager
async def shown(client: RunClient, size: tuple[int, int] = SMALL, *, commands: bool = False):
    app = MonitorApp(client, commands=commands)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield app, pilot


async def pressed(app: MonitorApp, pilot, *keys: str) -> str:
    await pilot.press(*keys)
    app.refresh_run()
    await pilot.pause()
    return text(app)


async def asked_for(app: MonitorApp, pilot, key: str) -> None:
    """Press a key and wait until its words can be typed."""
    await pilot.press(key)
    async with asyncio.timeout(10.0):
        while not (isinstance(app.screen, Confirm) and isinstance(app.focused, Input)):
            await pilot.pause()


async def answered(app: MonitorApp, pilot) -> str:
    """Return what the terminal shows when everything has been said."""
    await app.workers.wait_for_complete()
    app.refresh_run()
    await pilot.pause()
    return text(app)


@pytest.mark.parametrize("size", [SMALL, LARGE])
async def test_every_view_shows_what_it_is_for(client: Heard, size: tuple[int, int]) -> None:
    client._add(RunEvent("run-1", 0, 0, 12.0, "U1 LEG_2", vehicle="U1", state="LEG_2"))
    async with shown(client, size) as (app, pilot):
        leg = client.state.receivers[0].leg
        wanted = {
            "1": ("paper-8", "live", "0/8 placed", "LEG_2", f"{leg.direction} {leg.guide}", "2/2",
                  f"{math.degrees(leg.angle_rad):.2f}", f"{leg.remaining_m:.1f}", "±", "hears"),
            "2": ("north up", "U1", "oO8", "*L0", "kept 5 m apart"),
            "3": ("GUIDED", "good", "80 %", "20.0"),
            "4": ("bus: connected", "recording: good"),
            "5": ("U1 LEG_2", "0:12"),
        }  # fmt: skip
        for key, words in wanted.items():
            screen = await pressed(app, pilot, key)
            assert [word for word in words if word not in screen] == [], screen
            assert "read-only" in screen


async def test_a_wide_screen_shows_more_at_once(client: Heard) -> None:
    client._add(RunEvent("run-1", 0, 0, 12.0, "something happened"))
    async with shown(client, LARGE) as (app, pilot):
        screen = await pressed(app, pilot, "1")
        for words in ("rate °/s", "over time", "something happened"):
            assert words in screen


async def test_alerts_come_first_with_what_to_do_and_leave_room_for_the_rest(client: Heard) -> None:
    many = [Alert("alert", f"U{k}", f"HELD: reason {k}", "bearing-relay control resume") for k in range(20)]
    client.hear(alerts=many)
    async with shown(client) as (app, pilot):
        screen = lines(app)
        assert "ALERT" in screen[1]
        assert "HELD: reason 0" in screen[1]
        assert "→ bearing-relay control resume" in screen[2]
        assert "and 18 more" in text(app)
        assert "UAV" in text(app)
        client.hear(alerts=[])
        assert "ALERT" not in await pressed(app, pilot, "1")


async def test_what_is_old_is_said_to_be_old(client: Heard) -> None:
    async with shown(client) as (app, pilot):
        client.clock.jump(LOST_S + 3.0)
        screen = await pressed(app, pilot, "1")
        assert "OLD 5 s" in screen
        assert "nothing heard of the run for 5 s" in screen
        client.hear()
        assert "live" in await pressed(app, pilot, "1")


async def test_a_run_that_has_ended_is_not_old(client: Heard) -> None:
    client.hear(phase="formed")
    async with shown(client) as (app, pilot):
        client.clock.jump(LOST_S + 3.0)
        screen = await pressed(app, pilot, "1")
        assert "ended" in screen
        assert "OLD" not in screen


async def test_before_any_run_the_screen_says_what_is_missing() -> None:
    client = RunClient(lambda: BusAddress("tcp/127.0.0.1:7447", "x"), ManualClock())
    client.problem = "no run in runs has a bus"
    async with shown(client) as (app, pilot):
        for key in "12345":
            assert "no run in runs has a bus" in await pressed(app, pilot, key)


async def test_without_the_token_nothing_can_be_said(client: Heard) -> None:
    async with shown(client) as (app, pilot):
        screen = await pressed(app, pilot, "h", "r", "a", "s", "p")
        assert client.asked == []
        assert "HOLD" not in screen
        assert not isinstance(app.screen, Confirm)


async def test_hold_is_one_key_and_the_answer_is_shown(client: Heard) -> None:
    async with shown(client, commands=True) as (app, pilot):
        await pilot.press("h")
        assert "it is done" in await answered(app, pilot)
        assert client.asked == [ControlRequest("hold")]
        for reply, words in (
            (ControlReply(ok=False, message="the relay has ended"), "the relay has ended"),
            (BusError("the run cannot be reached"), "the run cannot be reached"),
        ):
            client.reply = reply
            await pilot.press("h")
            assert words in await answered(app, pilot)


@pytest.mark.parametrize(
    ("key", "typed", "said"),
    [
        ("a", "abort", [ControlRequest("abort")]),
        ("a", "abor", []),
        ("a", "", []),
        ("r", "resume", [ControlRequest("resume")]),
        ("r", "abort", []),
        ("s", "U3", [ControlRequest("skip", "U3")]),
        ("p", "L0", [ControlRequest("release", "L0")]),
        ("s", "", []),
    ],
)
async def test_everything_else_has_to_be_typed(client: Heard, key: str, typed: str, said: list[ControlRequest]) -> None:
    async with shown(client, commands=True) as (app, pilot):
        await asked_for(app, pilot, key)
        assert client.asked == []
        await pilot.press(*typed, "enter")
        assert ("it is done" if said else "nothing was said") in await answered(app, pilot)
        assert client.asked == said


async def test_escape_leaves_without_a_word(client: Heard) -> None:
    async with shown(client, commands=True) as (app, pilot):
        await asked_for(app, pilot, "a")
        await pilot.press(*"abort", "escape")
        assert "nothing was said" in await answered(app, pilot)
        assert not isinstance(app.screen, Confirm)
        assert client.asked == []


async def test_the_log_is_filtered_by_words(client: Heard) -> None:
    for number, words in enumerate(("U1 LEG_1", "U2 HELD: no bearings", "U1 LEG_2")):
        client._add(RunEvent("run-1", number, 0, float(number), words))
    async with shown(client) as (app, pilot):
        await pilot.press("slash", *"held", "enter")
        await pilot.pause()
        screen = text(app)
        assert "U2 HELD" in screen
        assert "LEG_1" not in screen
        assert app.query_one("#filter", Input).has_class("hidden")


async def test_the_map_turns(client: Heard) -> None:
    async with shown(client) as (app, pilot):
        north = await pressed(app, pilot, "2")
        formation = await pressed(app, pilot, "n")
        assert "formation up" in formation
        assert north != formation
        assert await pressed(app, pilot, "n") == north


async def test_twenty_receivers_fit_by_scrolling(flown: ToldWorld) -> None:
    client = Heard(flown)
    first = flown.told.receivers[0]
    client.hear(receivers=[msgspec.structs.replace(first, name=f"V{k}", leg=None) for k in range(40)])
    async with shown(client) as (app, pilot):
        assert "V39" not in text(app)
        await pilot.press("pagedown", "pagedown")
        await pilot.pause()
        assert "V39" in text(app)


async def test_nothing_is_drawn_while_nothing_is_new(client: Heard) -> None:
    async with shown(client) as (app, _):
        drawn = []
        view = app.query_one("#view", Static)
        update = view.update
        view.update = lambda what: (drawn.append(what), update(what))
        for _ in range(10):
            app.refresh_run()
        client.hear(phase="landing")
        app.refresh_run()
        app.refresh_run()
        assert len(drawn) == 1


def plain(what: object, width: int = 80) -> list[str]:
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(what)
    return console.export_text().splitlines()


@pytest.mark.parametrize("width", [80, 140])
def test_no_row_is_wider_than_the_terminal(flown: ToldWorld, width: int) -> None:
    spans = {"U1": [Span("WAITING", 0.0, 3.0), Span("LEG_1", 3.0)]}
    for view in (
        views.relay_table(flown.told, width),
        views.vehicle_table(flown.told, width),
        views.gantt(flown.told, flown.setup, spans, width),
        views.health(msgspec.structs.replace(flown.told, links=[LINK] * 3)),
    ):
        assert max(map(len, plain(view, 400))) <= width


def test_the_gantt_chart_shows_what_was_is_and_will_be(flown: ToldWorld) -> None:
    spans = {
        "U1": [Span("WAITING", 0.0, 3.0), Span("LEG_1", 3.0, 9.0), Span("HELD", 9.0)],
        "U2": [Span("WAITING", 0.0)],
    }
    header, first, second, *_ = plain(views.gantt(flown.told, flown.setup, spans, 80))
    now = first.index("|")
    assert second.index("|") == now
    assert "=" in first[:now]
    assert "!" in first[:now]
    assert "-" in second[now:]
    assert header.startswith("UAV")


def test_the_map_is_to_scale_and_north_is_up(flown: ToldWorld) -> None:
    setup = msgspec.structs.replace(flown.setup, axis_azimuth_rad=math.pi / 2, slots={}, routes=[], fence=[])
    far = msgspec.structs.replace(setup, transmitters=[
        msgspec.structs.replace(setup.transmitters[0], name=name, at_m=at)
        for name, at in {"W": (-40.0, 0.0), "E": (40.0, 0.0), "S": (0.0, -20.0), "N": (0.0, 20.0)}.items()
    ])  # fmt: skip
    state = RunState("run-1", 0, 0, 0, "relay", 0.0)
    rows = formation_map(state, far, {}, 81, 25, north_up=True).plain.splitlines()
    where = {name: (row.index(name), number) for number, row in enumerate(rows[:-1]) for name in "WENS" if name in row}
    assert where["N"][1] < where["W"][1] == where["E"][1] < where["S"][1]
    assert where["W"][0] < where["N"][0] == where["S"][0] < where["E"][0]
    east_west, north_south = where["E"][0] - where["W"][0], where["S"][1] - where["N"][1]
    assert east_west / 80.0 == pytest.approx(2 * north_south / 40.0, rel=0.1)  # a character is twice as high as wide


def test_the_angle_closes_on_its_stop() -> None:
    samples = [AngleSample(k * 0.2, 2, 1.0 - 0.01 * k, 0.5, 0.001) for k in range(50)]
    rows = [row.rstrip() for row in angle_chart(samples, 60, 10).plain.splitlines()]
    assert len(rows) == 10
    assert rows[0].startswith("  57.30 o")
    assert "28.65" in rows[-1]
    assert rows[-1].endswith("o")
    assert "-" in rows[-1]


def test_an_angle_chart_begins_anew_with_another_leg_or_another_flight() -> None:
    first = [AngleSample(k * 0.2, 1, 3.0, 2.9, 0.001) for k in range(5)]
    second = [AngleSample(10.0 + k * 0.2, 2, 1.0, 0.9, 0.001) for k in range(5)]
    again = [AngleSample(40.0 + k * 0.2, 2, 0.95, 0.9, 0.001) for k in range(5)]
    assert "171" not in angle_chart([*first, *second], 40, 6).plain
    assert "57.30" not in angle_chart([*first, *second, *again], 40, 6).plain
    assert angle_chart([], 40, 6).plain == "no angle yet"
