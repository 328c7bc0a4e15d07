"""What an autopilot says in words: STATUSTEXT, a longer one in several pieces. No text can steer a terminal."""

from __future__ import annotations

from typing import Final

from drivers.mavlink.codec import Message

PIECE_LENGTH: Final = 50
_MOST_PIECES: Final = 10
"""No autopilot says more at a time."""


class StatusTexts:
    """Puts the pieces of long texts together; a text whose end is lost comes out when the next one begins."""

    def __init__(self) -> None:
        self._id = 0
        self._pieces: list[str] = []

    def take(self, message: Message) -> list[str]:
        """Return the texts that one STATUSTEXT completes."""
        complete: list[str] = []
        if self._pieces and message.id != self._id:
            complete.append(self._finish())
        if message.id == 0:
            return [*complete, _printable(message.text)]
        self._id = message.id
        self._pieces.append(message.text)
        if len(message.text) < PIECE_LENGTH or len(self._pieces) == _MOST_PIECES:
            complete.append(self._finish())
        return complete

    def _finish(self) -> str:
        text, self._pieces = "".join(self._pieces), []
        return _printable(text)


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)
