"""Which message a topic of the recording carries, and its JSON Schema in the form that viewers of MCAP files read.

A topic is a key of the bus, or says what the service itself notes down besides.
"""

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
from drivers.strict_json import ESCAPES, malformed, read_json
from gcs.traced_monitor import MonitorNote

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

_MONITOR: Final = "monitor/"
_KINDS: Final[tuple[type[msgspec.Struct], ...]] = (*MESSAGES.values(), MonitorNote)
_DECODERS: Final[Mapping[type[msgspec.Struct], msgspec.json.Decoder[Any]]] = MappingProxyType(
    {kind: msgspec.json.Decoder(kind) for kind in _KINDS}
)


class Unreadable(msgspec.Struct, frozen=True):
    """A payload that is not what its key promises, as it came."""

    problem: str
    payload: bytes
    """Base64 in JSON."""


def every_message(keys: SwarmKeys) -> str:
    """Return the key expression that matches everything said in a swarm."""
    return f"bearing-relay/{keys.swarm}/**"


def monitor_topic(receiver: str) -> str:
    """Return the topic of what a receiver's stop monitors were told and answered; no key of the bus begins so."""
    return _MONITOR + receiver


def monitored(topic: str) -> str | None:
    """Return the receiver whose stop monitors a topic is about, or None."""
    return topic.removeprefix(_MONITOR) if topic.startswith(_MONITOR) else None


def message_on(topic: str) -> type[msgspec.Struct] | None:
    """Return which message a topic carries, or None when that is not known."""
    return MonitorNote if topic.startswith(_MONITOR) else MESSAGES.get(topic.rpartition("/")[2])


def decoded(payload: bytes, topic: str) -> Any:
    """Return the message that a topic's payload holds; of a topic nobody knows, the JSON object.

    MalformedMessageError says which field is wrong and how.
    """
    kind = message_on(topic)
    try:
        return read_json(payload, dict[str, Any]) if kind is None else _DECODERS[kind].decode(payload)
    except ESCAPES as error:
        raise malformed(error) from None


def schema_of(message: type[msgspec.Struct]) -> bytes:
    """Return the JSON Schema of a message, an object at its root; parts are referred to within it."""
    (root,), components = msgspec.json.schema_components([message], ref_template="#/$defs/{name}")
    parts: dict[str, Any] = dict(components)
    schema = parts.pop(root["$ref"].rpartition("/")[2])
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "$defs": parts}).encode()
