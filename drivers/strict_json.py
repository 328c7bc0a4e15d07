"""JSON that somebody else wrote, maybe in bad faith: read, or refused with one kind of error, whatever is in it."""

from __future__ import annotations

from typing import Any, Final, TypeVar

import msgspec

_Kind = TypeVar("_Kind")

MalformedError = msgspec.MsgspecError

ESCAPES: Final = (UnicodeDecodeError, RecursionError)
"""What msgspec lets out besides its own errors: of bytes that are no text, and of what is nested without end."""


def read_json(data: bytes | str, kind: type[_Kind]) -> _Kind:
    """Return what JSON holds as a kind that msgspec knows. MalformedError says what is wrong."""
    try:
        return msgspec.json.decode(data, type=kind)
    except ESCAPES as error:
        raise malformed(error) from None


def read_any_json(data: bytes | str) -> Any:
    """Return what JSON holds, as plain values. MalformedError says what is wrong."""
    return read_json(data, Any)


def malformed(error: Exception) -> msgspec.DecodeError:
    """Return one of the `ESCAPES` as the error that it is: the JSON is malformed."""
    return msgspec.DecodeError("it is nested too deeply" if isinstance(error, RecursionError) else f"no text: {error}")
