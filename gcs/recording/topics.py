"""Which message is on which key of the bus, and its JSON Schema in the form that viewers of MCAP files read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import msgspec

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import (
    BearingReport,
    ClockPing,
    ClockPong,
    ControlReply,
    ControlRequest,
    Emission,
    PositionReport,
    Progress,
    SensorFault,
)

MESSAGES: Final[Mapping[str, type[msgspec.Struct]]] = MappingProxyType(
    {
        "bearings": BearingReport,
        "position": PositionReport,
        "emission": Emission,
        "sensor": SensorFault,
        "progress": Progress,
        "clock_ping": ClockPing,
        "clock_pong": ClockPong,
        "request": ControlRequest,
        "reply": ControlReply,
    }
)
"""What is said on the keys that end in this word. Control is asked and answered on one key, and recorded on two."""


class Unreadable(msgspec.Struct, frozen=True):
    """A payload that is not what its key promises, as it came."""

    problem: str
    payload: bytes
    """Base64 in JSON."""


def every_message(keys: SwarmKeys) -> str:
    """Return the key expression that matches everything said in a swarm."""
    return f"bearing-relay/{keys.swarm}/**"


def message_on(key: str) -> type[msgspec.Struct] | None:
    """Return which message a key carries, or None when that is not known."""
    return MESSAGES.get(key.rpartition("/")[2])


def schema_of(message: type[msgspec.Struct]) -> bytes:
    """Return the JSON Schema of a message, an object at its root; parts are referred to within it."""
    (root,), components = msgspec.json.schema_components([message], ref_template="#/$defs/{name}")
    parts: dict[str, Any] = dict(components)
    schema = parts.pop(root["$ref"].rpartition("/")[2])
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "$defs": parts}).encode()
