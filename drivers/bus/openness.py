"""Whether strangers can get at a bus: anybody can who reaches it, unless only this machine does or it takes keys."""

from __future__ import annotations

import ipaddress
import re
from typing import Final

_ENDPOINT: Final = re.compile(r"[a-z]+/(?:\[(?P<six>[^\[\]]+)\]|(?P<host>[^\[\]:/?#;]+)):\d{1,5}")
"""PROTOCOL/HOST:PORT and nothing behind it: what else zenoh would read there is not judged here."""


def openness(endpoint: str) -> str | None:
    """Return why strangers can get at the bus at an endpoint, when it takes no keys; None when they cannot."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:
        return f"{endpoint!r} is no endpoint of a bus: write it as tcp/HOST:PORT"
    if is_loopback(match["six"] or match["host"]):
        return None
    return (
        f"whoever reaches the bus at {endpoint} can join it and command the swarm: close it with the keys of "
        "`bearing-relay keys init`"
    )


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches a host name or address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
