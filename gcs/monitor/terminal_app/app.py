"""The terminal monitor: alerts first, then whichever view is wanted. It reads, and commands only where it may."""

from __future__ import annotations

from typing import ClassVar, Final

from rich.console import Group, RenderableType
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Footer, Input, Static

from drivers.bus.messages import ControlRequest
from drivers.errors import BusError
from drivers.tasks import background
from gcs.monitor.client import RunClient
from gcs.monitor.terminal_app import views
from gcs.monitor.terminal_app.angle_chart import angle_chart
from gcs.monitor.terminal_app.confirm import Confirm
from gcs.monitor.terminal_app.map_view import formation_map

REFRESH_S: Final = 0.1
"""How often it is looked whether there is anything new to draw."""
_REDRAWN_S: Final = 1.0
_LOG_LINES: Final = 300
_CHARTS: Final = 3
_CHART_ROWS: Final = 12
_VIEWS: Final = ("relay", "map", "vehicles", "health", "log")


class MonitorApp(App[None]):
    """Shows a run. `commands`: whether the operator's words may be said from here."""

    TITLE = "bearing-relay monitor"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head { height: 1; }
    #alerts { height: auto; max-height: 40%; }
    #main { height: 1fr; }
    #scroll { width: 2fr; }
    #view { height: auto; }
    #side { width: 1fr; padding-left: 2; }
    #wide-log { height: 9; border-top: solid $accent; }
    #filter { height: 3; }
    #answer { height: auto; }
    .hidden { display: none; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(str(key), f"look('{view}')", view) for key, view in enumerate(_VIEWS, start=1)),
        Binding("n", "turn", "north up", show=False),
        Binding("slash", "filter", "filter", show=False),
        Binding("h", "hold", "HOLD ALL"),
        Binding("r", "say('resume')", "resume"),
        Binding("s", "say('skip')", "skip"),
        Binding("p", "say('release')", "release"),
        Binding("a", "say('abort')", "abort"),
        Binding("q", "quit", "quit"),
    ]

    def __init__(self, client: RunClient, *, commands: bool) -> None:
        super().__init__()
        self._client = client
        self._commands = commands
        self._shown = "relay"
        self._north_up = True
        self._wanted = ""
        self._answer = Text("" if commands else "read-only: commands need the token", style="dim")
        self._drawn: object = None

    def compose(self) -> ComposeResult:
        """Lay out the screen."""
        yield Static(id="head")
        yield Static(id="alerts")
        with Horizontal(id="main"):
            with VerticalScroll(id="scroll"):
                yield Static(id="view")
            yield Static(id="side")
        yield Static(id="wide-log")
        yield Input(id="filter", classes="hidden", placeholder="words that lines of the log hold; Enter leaves")
        yield Static(id="answer")
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Begin to draw."""
        self.query_one("#scroll").focus()
        self.set_interval(REFRESH_S, self.refresh_run)
        self.refresh_run()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer commands only where they may be said."""
        del parameters
        return self._commands or action not in ("hold", "say")

    def refresh_run(self) -> None:
        """Draw what is new; nothing when nothing is."""
        client, scroll = self._client, self.query("#scroll")
        if not scroll:
            return  # the screen is being taken down
        whole_s, room = round(client.clock.now_s() / _REDRAWN_S), scroll.first().size
        chosen = (self._shown, self._wanted, self._answer, self._north_up)
        new = (client.state, len(client.events), client.lost, whole_s, room, chosen)
        if new == self._drawn:
            return
        self._drawn = new
        wide = self.size.width >= views.WIDE
        self._put("head", views.head(client.state, client.setup, client.age_s(), lost=client.lost, ended=client.ended))
        self._put("alerts", views.alert_lines(client.alerts(), max(2, self.size.height // 8)))
        self._put("view", self._view())
        self._put("side", self._side() if wide and self._shown == "map" else None)
        self._put("wide-log", self._events(8) if wide and self.size.height >= 36 and self._shown != "log" else None)
        self._put("answer", self._answer if self._answer.plain else None)

    def _put(self, name: str, what: RenderableType | None) -> None:
        widget = self.query_one(f"#{name}", Static)
        widget.set_class(what is None, "hidden")
        if what is not None:
            widget.update(what)

    def _view(self) -> RenderableType:
        client, width = self._client, self.size.width - 2
        state, setup = client.state, client.setup
        if state is None:
            return Text("nothing to show yet: this waits, and tries again", style="dim")
        if self._shown == "vehicles":
            return views.vehicle_table(state, width)
        if self._shown == "health":
            return views.health(state)
        if self._shown == "log":
            return self._events(_LOG_LINES)
        if self._shown == "map" and setup is not None:
            room = self.query_one("#scroll").size
            tracks = {name: list(track) for name, track in client.history.tracks.items()}
            return formation_map(state, setup, tracks, room.width - 2, max(room.height, 8), north_up=self._north_up)
        parts: list[RenderableType] = [views.relay_table(state, width), *views.leg_lines(state)]
        if setup is not None:
            spans = {receiver.name: client.history.spans(receiver.name) for receiver in state.receivers}
            parts += [Text(""), views.gantt(state, setup, spans, width)]
        if width >= views.WIDE:
            parts += [Text(""), *self._charts(width)]
        return Group(*parts)

    def _side(self) -> RenderableType:
        return Group(*self._charts(self.size.width // 3 - 3))

    def _charts(self, columns: int) -> list[RenderableType]:
        """Return the angle over time of the first few whose angles close on their stops."""
        state, charts = self._client.state, list[RenderableType]()
        for receiver in () if state is None else state.receivers:
            if receiver.leg is not None and len(charts) < 2 * _CHARTS:
                samples = tuple(self._client.history.angles.get(receiver.name, ()))
                first, second = receiver.leg.stop_reference
                charts.append(Text(f"{receiver.name}: angle {first}-{second} over time, °", style="bold"))
                charts.append(angle_chart(samples, columns, _CHART_ROWS))
        return charts

    def _events(self, most: int) -> RenderableType:
        lines = views.log_lines(reversed(self._client.events), most, self._wanted)
        head = [Text(f"lines with “{self._wanted}” (/ changes that)", style="bold")] if self._wanted else []
        return Group(*head, *(lines or [Text("nothing yet", style="dim")]))

    def action_look(self, view: str) -> None:
        """Show another view."""
        self._shown = view
        self.query_one("#scroll", VerticalScroll).scroll_home(animate=False)
        self.refresh_run()

    def action_turn(self) -> None:
        """Turn the map: north up, or formation up."""
        self._north_up = not self._north_up
        self.refresh_run()

    def action_filter(self) -> None:
        """Ask for the words that lines of the log are to hold."""
        self._shown = "log"
        field = self.query_one("#filter", Input)
        field.remove_class("hidden")
        field.focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Filter while it is typed."""
        if event.input.id == "filter":
            self._wanted = event.value
            self.refresh_run()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Leave the filter as it is."""
        if event.input.id == "filter":
            event.input.add_class("hidden")
            self.query_one("#scroll").focus()

    def action_hold(self) -> None:
        """Stop everybody, at once: that can do no harm."""
        self.run_worker(self._command(ControlRequest("hold")))

    def action_say(self, verb: str) -> None:
        """Ask for the words that say so, then say them."""
        self.run_worker(self._asked(verb))

    async def _asked(self, verb: str) -> None:
        if verb in ("skip", "release"):
            name = await self.push_screen_wait(Confirm(f"{verb} whom? Type its name; Escape leaves.", "U1"))
            request = ControlRequest("skip" if verb == "skip" else "release", name) if name else None
        else:
            typed = await self.push_screen_wait(
                Confirm(f"Type {verb} and Enter to {verb} the relay; Escape leaves.", verb)
            )
            request = ControlRequest("abort" if verb == "abort" else "resume") if typed == verb else None
        if request is None:
            self._tell(Text(f"{verb}: nothing was said", style="dim"))
        else:
            await self._command(request)

    async def _command(self, request: ControlRequest) -> None:
        words = " ".join(filter(None, (request.verb, request.vehicle)))
        self._tell(Text(f"{words} …", style="bold"))
        try:
            reply = await self._client.command(request)
        except BusError as error:
            self._tell(Text(f"{words}: {error}", style="bold red"))
        else:
            self._tell(Text(f"{words}: {reply.message}", style="bold green" if reply.ok else "bold red"))

    def _tell(self, answer: Text) -> None:
        self._answer = answer
        self.refresh_run()


async def show(client: RunClient, *, commands: bool) -> None:
    """Show a run until somebody quits."""
    app = MonitorApp(client, commands=commands)
    async with background(client.follow()):
        await app.run_async()
