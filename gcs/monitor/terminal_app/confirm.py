"""A word to the relay that has to be typed: nobody aborts a relay by leaning on the keyboard."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static


class Confirm(ModalScreen[str | None]):
    """Asks for words; returns them, or None when Escape is pressed."""

    BINDINGS = [("escape", "leave", "leave")]  # noqa: RUF012 - Textual reads it from the class
    CSS = """
    Confirm { align: center middle; }
    Confirm > Vertical { width: 66; max-width: 95%; height: auto; border: heavy $warning; padding: 0 1; }
    """

    def __init__(self, question: str, placeholder: str) -> None:
        super().__init__()
        self._question = question
        self._placeholder = placeholder

    def compose(self) -> ComposeResult:
        """Show the question and where the answer is typed."""
        with Vertical():
            yield Static(self._question, markup=False)
            yield Input(placeholder=self._placeholder)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return what was typed."""
        self.dismiss(event.value.strip())

    def action_leave(self) -> None:
        """Return nothing."""
        self.dismiss(None)
