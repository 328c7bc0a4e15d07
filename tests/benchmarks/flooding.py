"""A flood, for benchmarks of a service: messages on the bus and datagrams on its MAVLink port, of many kinds."""

from __future__ import annotations

import contextlib
import itertools
import json
import random
import signal
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import Final

import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.bus.session import BusEndpoint
from tests.benchmarks.swarm import KEYS

VICTIM: Final = 5
"""The number of the vehicle in whose name others speak."""
OVERSIZED: Final = b"[" * 6_000_000, b"[" * 1_000_000
"""More than the bus carries, and less."""
_REPORT: Final = (
    b'{"captured_ns":%d,"sequence":%d,"reference":"true_north","bearings":[{"transmitter":"L0","azimuth_rad":1.0%03d,'
    b'"sigma_rad":0.002},{"transmitter":"L1","azimuth_rad":2.0,"sigma_rad":0.002}]}'
)
BATCH_S = 0.01
KINDS = ("unknown", "own key", "oversized", "noise", "victim", "malformed", "control", "frames")
_SHARES = {"unknown": 0.3, "own key": 0.2, "victim": 0.2, "malformed": 0.25, "control": 0.05}
"""Of the rate on the bus; the others have a rate of their own."""
_OVERSIZED_HZ = 20.0
_DATAGRAMS_HZ = 5000.0


def flood(endpoint: str, port: int, rate_hz: float, *wanted: str) -> None:
    """Flood with some kinds until told to end; then print what was sent."""
    sent: Counter[str] = Counter()
    going = True

    def end(*_: object) -> None:
        nonlocal going
        going = False

    signal.signal(signal.SIGTERM, end)
    with (
        zenoh.open(BusEndpoint(endpoint).configuration()) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire,
    ):
        wire.connect(("127.0.0.1", port))
        wire.settimeout(0.0)
        senders = {kind: (rate_hz * share, _sender(kind, session)) for kind, share in _SHARES.items()}
        senders |= {"oversized": (_OVERSIZED_HZ, _sender("oversized", session))}
        senders |= {kind: (_DATAGRAMS_HZ / 2, _spray(kind, wire)) for kind in ("noise", "frames")}
        senders = {kind: sender for kind, sender in senders.items() if kind in wanted}
        owed = dict.fromkeys(senders, 0.0)
        began_s = last_s = time.monotonic()
        while going:
            now_s = time.monotonic()
            for kind, (hz, send) in senders.items():
                owed[kind] = min(owed[kind] + hz * (now_s - last_s), hz)
                for _ in range(int(owed[kind])):
                    send()
                sent[kind] += int(owed[kind])
                owed[kind] %= 1.0
            last_s = now_s
            time.sleep(max(0.0, now_s + BATCH_S - time.monotonic()))
    lasted_s = time.monotonic() - began_s
    print(f"offered {sum(sent.values()) / lasted_s:.0f} a second: {json.dumps(sent)}", flush=True)


def _sender(kind: str, session: zenoh.Session) -> Callable[[], None]:
    """Return what puts one message of a kind on the bus."""
    numbers = itertools.count()
    if kind == "control":
        querier = session.declare_querier(KEYS.control, timeout=1.0)
        request = b'{"verb":"hold"}'
        return lambda: querier.get(lambda _reply: None, payload=request)
    if kind == "own key":
        return lambda: session.put(KEYS.bearings(f"X{next(numbers)}"), _report(next(numbers)))
    name = {"unknown": "Z1", "oversized": "Z1"}.get(kind, f"U{VICTIM}")
    publisher = session.declare_publisher(KEYS.bearings(name), priority=zenoh.Priority.INTERACTIVE_HIGH)
    payloads = {"malformed": itertools.repeat(b'{"captured_ns": "soon"}'), "oversized": itertools.cycle(OVERSIZED)}
    reports = map(_report, numbers)
    return lambda: publisher.put(next(payloads.get(kind, reports)))


def _report(number: int) -> bytes:
    return _REPORT % (time.time_ns(), number, number % 1000)


def _spray(kind: str, wire: socket.socket) -> Callable[[], None]:
    """Return what sends one datagram of a kind."""
    rng = random.Random(1)
    noise = [rng.randbytes(rng.randrange(1, 1400)) for _ in range(200)]
    frames = []
    for system_id in range(1, 256):
        sender = mavlink.MAVLink(None, system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        frames.append(bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3).pack(sender)))
    datagrams = itertools.cycle(noise if kind == "noise" else frames)

    def send() -> None:
        with contextlib.suppress(OSError):
            wire.send(next(datagrams))

    return send
