"""What no honest writer writes: values, structures and bytes made from good ones, and what may come of them."""

from __future__ import annotations

import contextlib
import copy
import json
import math
import time
from collections.abc import Iterator
from typing import Any

import msgspec
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from drivers.errors import DriverError
from gcs.errors import ServiceError
from planner.errors import PlannerError

OWN_ERRORS = (ServiceError, DriverError, PlannerError)
"""What may reach the user: each is printed as one message."""

HUGE = 10**400
NUMBERS = (0, 1, -1, 255, 2**31, 2**63 - 1, 2**63, -(2**64), 10**30, HUGE, 0.5, -0.0, 1e-320, 1e308, 1e400, math.nan)
TEXTS = ("", " ", "\x00", "\x1b[31m", "a/b", "**", "..", "-1", "nan", "1e999", "\ud800", "é🚁", "x" * 5000)
NESTED = ([], {}, [[]], {"": None}, [HUGE], {"a": math.nan}, [None] * 300, {"a": {"b": ["c"]}}, ["L0", "L1"])

values = (
    st.sampled_from(NUMBERS)
    | st.sampled_from(TEXTS)
    | st.sampled_from(NESTED).map(copy.deepcopy)
    | st.sampled_from((None, True, False))
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
)


def examples(count: int) -> settings:
    """Run this many examples, always the same; a hundred times as many, always others, with the profile `long`."""
    long = settings.get_current_profile_name() == "long"
    return settings(
        max_examples=count * (100 if long else 1),
        derandomize=not long,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


@contextlib.contextmanager
def ends_well(longest_s: float = 10.0) -> Iterator[None]:
    """Let nothing out of the block but what the user may see, in words; let it take no longer than `longest_s`."""
    began_s = time.process_time()
    try:
        yield
    except OWN_ERRORS as error:
        assert str(error).strip()  # noqa: PT017 - whether it raises is not the question
    assert time.process_time() - began_s < longest_s


@st.composite
def mutated(draw: st.DrawFn, document: Any) -> Any:
    """Return a copy of a document of lists and dicts in which one to three places are changed."""
    made = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        made = _changed(draw, made)
    return made


def _changed(draw: st.DrawFn, document: Any) -> Any:
    places = list(_places(document))
    if not places:
        return draw(values)
    holder, key = draw(st.sampled_from(places))
    how = draw(st.sampled_from(("replace", "replace", "remove", "add", "nest", "swap")))
    if how == "remove":
        del holder[key]
    elif how == "add" and isinstance(holder, dict):
        holder[draw(st.text(max_size=8))] = draw(values)
    elif how == "add":
        holder.insert(key, draw(values))
    elif how == "nest":
        holder[key] = draw(st.sampled_from(([holder[key]], {"a": holder[key]})))
    elif how == "swap":
        other, there = draw(st.sampled_from(places))
        holder[key] = copy.deepcopy(other[there])
    else:
        holder[key] = draw(values)
    return document


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every place in a document as (what holds it, key or index)."""
    if isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield node, key
            yield from _places(value)


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """Return bytes of which something is flipped, cut off, cut out, repeated or put in between."""
    made = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(made)))
        length = draw(st.integers(0, 64))
        how = draw(st.sampled_from(("flip", "cut", "take out", "repeat", "insert")))
        if how == "flip" and at < len(made):
            made[at] ^= draw(st.integers(1, 255))
        elif how == "cut":
            del made[at:]
        elif how == "take out":
            del made[at : at + length]
        elif how == "repeat":
            made[at:at] = made[at : at + length]
        else:
            made[at:at] = draw(st.binary(max_size=16) | st.sampled_from((b"[" * 5000, b'{"a":' * 5000, b"9" * 5000)))
    return bytes(made)


def as_json(document: Any) -> bytes:
    """Return a document as JSON as Python writes it, which says NaN and numbers of any size."""
    return json.dumps(document).encode("utf-8", errors="surrogatepass")


def plain(message: msgspec.Struct) -> Any:
    """Return a message as a document."""
    return msgspec.json.decode(msgspec.json.encode(message))
