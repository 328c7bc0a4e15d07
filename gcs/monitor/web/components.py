"""The panels of the page: each a Vue component of its own, beside its siblings in `assets`."""

from __future__ import annotations

from nicegui import ui


class TopBar(ui.element, component="assets/top_bar.js"):
    """Which run, how far, how fresh; and the button that stops everything."""


class AlertList(ui.element, component="assets/alert_list.js"):
    """What is wrong, and what to do about it."""


class FormationMap(ui.element, component="assets/formation_map.js"):
    """The formation from above, to scale."""


class AnglePanel(ui.element, component="assets/angle_panel.js"):
    """The receiver in motion, and its angle against time."""


class RelayPanel(ui.element, component="assets/relay_panel.js"):
    """Every receiver in a row, with its time line."""


class CommandPanel(ui.element, component="assets/command_panel.js"):
    """The operator's words, and the relay's answers."""


class HealthPanel(ui.element, component="assets/health_panel.js"):
    """Links, vehicles, sensors, bus and recording."""


class EventPanel(ui.element, component="assets/event_panel.js"):
    """The event log."""


def build() -> None:
    """Put the panels onto the page, in the order in which they are read."""
    ui.add_head_html('<link rel="stylesheet" href="/assets/dashboard.css">')
    ui.add_body_html('<a class="skip" href="#board">Skip to the board</a>')
    TopBar()
    with ui.element("main").props("id=board"):
        AlertList()
        with ui.element("div").classes("board"):
            with ui.element("div").classes("side left"):
                FormationMap()
                RelayPanel()
                EventPanel()
            with ui.element("div").classes("side right"):
                CommandPanel()
                AnglePanel()
                HealthPanel()
