"""What is wrong in a playbook, at its place: unknown names with the nearest known one, several problems at once."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from typing import Final

from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

REFUSED: Final = "refused"
"""The type of pydantic's errors that say everything in their message."""

Location = tuple[str | int, ...]
Problem = tuple[Location, str]
"""Where something is wrong, as keys and places in lists, and what."""


def suggestion(found: str, allowed: Collection[str]) -> str:
    """Return what to say behind an unknown name: the nearest known one, and all that are known; nothing for none."""
    if not allowed:
        return ""
    nearest = difflib.get_close_matches(found, allowed, n=1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    return f"{hint} (allowed are {', '.join(allowed)})"


def refuse(problems: Iterable[Problem]) -> None:
    """Return when there are no problems; else raise them all, for a validator to let through with their places."""
    details = [
        InitErrorDetails(type=PydanticCustomError(REFUSED, "{message}", {"message": message}), loc=location, input=None)
        for location, message in problems
    ]
    if details:
        raise ValidationError.from_exception_data("playbook", details)
