"""What a closed bus refuses is counted, by kind and by whom: by a router's log, and by a real router."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import math
import os
import ssl
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.refusal_log import SOMEBODY, Tally
from drivers.bus.refusals import Refusals, decode_refusals, encode_refusals, refusals_key
from drivers.bus.routing import SAID_EVERY_S, UNHEARD_LOOKS, Screen
from drivers.bus.security import OPERATOR, ROUTER, SERVICE, KeyedEndpoint, configurations, node_party, uav_party
from drivers.bus.session import LiveBus, open_bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port
from drivers.strict_json import MalformedError
from tests.drivers.bus.test_security import STRANGERS

SWARM = "eight"
KEYS = SwarmKeys(SWARM)
U1, NORTH = uav_party("U1"), node_party("north")
PATIENCE_S = 20.0
SESSION = "2da" * 10
OF_U2 = "bearing-relay/eight/uav/U2/bearings"


def event(said: str, thread: int = 7, source: str = "zenoh::net::routing::interceptor::access_control") -> bytes:
    """Return an event as zenoh 1.10 logs it."""
    level = "TRACE" if source.endswith("access_control") else " WARN"
    return f"2026-08-06T05:54:31.491952Z {level}  rx-0 ThreadId(0{thread}) {source}: {said}\n".encode()


def denied(what: str, key: str = OF_U2, party: str = U1, interface: str = "lo", session: str = SESSION) -> str:
    subject = f"Interface({interface})+CertCommonName({party})+Transport(Tls)+{session}"
    return f"{session} on {subject} is unauthorized to {what} (ingress) on {key}"


def looking_ahead(key: str = OF_U2) -> list[str]:
    """What is logged when somebody gives a key a number: what would be denied, of which nothing has happened."""
    kinds = ("Query", "Reply", "Put", "Delete", "Declare/Undeclare Subscriber", "Declare/Undeclare Queryable")
    rest = ("Declare/Undeclare Liveliness Token", "Liveliness Query", "Declare Liveliness Subscriber")
    return [f"ACL (ingress): caching permissions for `{key}` ...", *(denied(what, key) for what in (*kinds, *rest))]


def tallied(*said: str) -> Tally:
    tally = Tally({U1, uav_party("U2"), SERVICE})
    for each in said:
        tally.take(event(each))
    return tally


def handshake(said: str) -> Refusals:
    tally = Tally({U1})
    tally.take(event(f"{said}. Hint: increase the system open file limit.", source="zenoh_link_tls::unicast"))
    return tally.refusals


@pytest.mark.parametrize(
    "said",
    [
        "received fatal alert: UnknownCA",
        "received corrupt message of type InvalidContentType",
        "invalid peer certificate: BadSignature",
        "peer sent no certificates",
    ],
)
def test_a_handshake_that_failed_was_a_stranger_s(said: str) -> None:
    assert handshake(said) == Refusals(strangers=1)


@pytest.mark.parametrize(
    "said", ["tls handshake eof", "Timeout during TLS handshake", "Connection reset by peer (os error 104)"]
)
def test_a_handshake_that_was_not_ended_was_nobody_s(said: str) -> None:
    assert handshake(said) == Refusals(broken_off=1)


@pytest.mark.parametrize("what", ["Put", "Delete", "Reply", "Declare Queryable", "Liveliness Token"])
def test_who_speaks_for_another_is_counted_by_his_certificate(what: str) -> None:
    assert tallied(denied(what), denied(what)).refusals == Refusals(speaking={U1: 2})


@pytest.mark.parametrize("what", ["Query", "Declare Subscriber", "Liveliness Query", "Declare Liveliness Subscriber"])
def test_who_asks_for_what_is_not_his_is_counted_by_his_certificate(what: str) -> None:
    assert tallied(denied(what)).refusals == Refusals(asking={U1: 1})


def test_what_would_be_denied_is_counted_when_it_happens() -> None:
    again = f"Using cached result: {SESSION} is unauthorized to Put (ingress) on {OF_U2}"
    assert tallied(*looking_ahead()).refusals.total == 0
    assert tallied(*looking_ahead(), again, again).refusals == Refusals(speaking={U1: 2})
    assert tallied(*looking_ahead(), denied("Put")).refusals == Refusals(speaking={U1: 1})
    assert tallied(*looking_ahead()[:4], denied("Put", KEYS.control)).refusals == Refusals(speaking={U1: 1})
    assert tallied(again).refusals == Refusals(speaking={SOMEBODY: 1})


def test_other_threads_look_ahead_by_themselves() -> None:
    tally = Tally({U1})
    tally.take(event(looking_ahead()[0], thread=8))
    tally.take(event(denied("Put"), thread=7))
    assert tally.refusals == Refusals(speaking={U1: 1})


def test_who_comes_in_at_several_interfaces_is_refused_once() -> None:
    at_both = [denied("Put", interface="eth0"), denied("Put", interface="eth1")]
    assert tallied(*at_both, *at_both).refusals == Refusals(speaking={U1: 2})
    begun, *ahead = looking_ahead()
    twice = [each.replace("lo", interface) for each in ahead for interface in ("eth0", "eth1")]
    assert tallied(begun, *twice).refusals == Refusals()


def test_a_key_cannot_pretend_to_be_another_event() -> None:
    forged = f"a\n{event(denied('Put', party=uav_party('U2'), session='abc')).decode()}"
    assert tallied(denied("Put", forged)).refusals == Refusals(speaking={U1: 1})
    assert tallied(denied("Put", f"x{denied('Put', party=uav_party('U2'))}")).refusals == Refusals(speaking={U1: 1})


@pytest.mark.parametrize("words", ["is authorized to Put (ingress) on b", "(egress) on b", "ACL (egress): ", "`"])
def test_a_key_cannot_hide_a_refusal(words: str) -> None:
    key = f"bearing-relay/a {words} b"
    assert tallied(denied("Put", key)).refusals == Refusals(speaking={U1: 1})
    again = f"Using cached result: {SESSION} is unauthorized to Put (ingress) on {key}"
    assert tallied(*looking_ahead(key), again).refusals == Refusals(speaking={U1: 1})


def test_what_is_allowed_and_what_others_do_not_hear_is_no_refusal() -> None:
    fine = [
        denied("Put").replace("unauthorized", "authorized"),
        denied("Put").replace("ingress", "egress"),
        "ACL (egress): caching permissions for `bearing-relay/eight` ...",
        denied("Undeclare Subscriber"),
    ]
    tally = tallied(*fine)
    assert (tally.refusals.total, tally.not_understood) == (0, 0)


def test_a_certificate_that_nobody_gave_rights_to_is_nobody_s_name() -> None:
    assert tallied(denied("Put", party="x" * 100)).refusals == Refusals(speaking={SOMEBODY: 1})
    without = f"{SESSION} did not match any configured ACL subject. Default permission `Deny` will be applied on all"
    assert tallied(without).refusals == Refusals(without_rights=1)


@pytest.mark.parametrize("said", [b"", b"\n", event("somebody was sent away"), b"\xff" * 200])
def test_an_event_that_is_not_understood_is_counted_as_such(said: bytes) -> None:
    tally = Tally({U1})
    tally.take(said)
    assert (tally.refusals.total, tally.not_understood) == (0, 1)


@given(st.binary(max_size=400), st.integers(0, 400))
def test_whatever_is_logged_is_taken(noise: bytes, at: int) -> None:
    tally = Tally({U1})
    whole = event(denied("Put"))
    for each in (noise, whole[:at] + noise + whole[at:], whole[:at], event(f"{SESSION} on {noise!r}")):
        tally.take(each)
    assert tally.refusals.total <= 3


def test_a_router_s_screen_says_what_has_grown_now_and_then_and_at_the_end(capsys: pytest.CaptureFixture[str]) -> None:
    tally = Tally({U1})
    screen = Screen(tally)
    screen.show(0.0)
    for second in range(4):
        tally.take(event(denied("Put")))
        screen.show(second * SAID_EVERY_S / 4.0)
    tally.take(b"what is this")
    screen.show(math.inf)
    screen.show(math.inf)
    said = [line.partition(" ")[2] for line in capsys.readouterr().err.splitlines()]
    assert [line.partition(" ")[0] for line in said[:2]] == ["1", "4"]
    assert len(said) == 3
    assert "not understood" in said[2]


def test_a_router_that_hears_nothing_of_its_log_says_that_it_may_not_count(capsys: pytest.CaptureFixture[str]) -> None:
    deaf, hearing = Tally({U1}), Tally({U1})
    hearing.take(event("Access control is enabled").replace(b"TRACE", b"DEBUG"))
    for tally in (deaf, hearing):
        screen = Screen(tally)
        for _ in range(UNHEARD_LOOKS + 2):
            screen.show(0.0)
    assert capsys.readouterr().err.count("not everything that is refused may be counted") == 1


def test_what_else_is_logged_is_left_to_others() -> None:
    tally = Tally({U1})
    assert not tally.take(event("Using ZID: 1", source="zenoh::net::runtime"))
    assert (tally.refusals.total, tally.not_understood) == (0, 0)


def test_what_was_refused_adds_up_and_is_said_on_a_line() -> None:
    one = Refusals(strangers=1, speaking={U1: 2}, asking={NORTH: 1})
    both = one + Refusals(1, 2, 3, {U1: 1, NORTH: 4})
    assert both == Refusals(2, 2, 3, {U1: 3, NORTH: 4}, {NORTH: 1})
    assert both.total == 15
    assert str(one) == (
        "4 refused on the bus: 1 stranger, 2 speaking for others (uav.U1 2), "
        "1 asking for what is not theirs (node.north 1)"
    )
    assert decode_refusals(encode_refusals(both)) == both
    for payload in (b"", b"[]", b'{"strangers": -1}', b'{"friends": 1}', b"\xff", b'{"speaking": {"U1": "x"}}'):
        with pytest.raises(MalformedError):
            decode_refusals(payload)


ROUTE = """
import asyncio, pathlib, sys
from drivers.bus.routing import route
from drivers.bus.session import BusEndpoint
asyncio.run(route(BusEndpoint(sys.argv[1], "router"), pathlib.Path(sys.argv[2]), None))
"""


class Closed:
    """A router of a closed bus as a process, and who joins it."""

    def __init__(self, folder: Path) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
        self.made = configurations(SWARM, ["U1", "U2"], self.endpoint, Authority(SWARM, now(), 2), ["north"])
        self.keys = folder / "router.json5"
        self.keys.write_text(self.made[ROUTER])
        self.keys.chmod(0o600)
        self.errors = folder / "router.log"

    def of(self, party: str) -> KeyedEndpoint:
        return KeyedEndpoint(self.endpoint, "client", self.made[party])

    @contextlib.contextmanager
    def routed(self) -> Iterator[None]:
        environment = {name: value for name, value in os.environ.items() if name != "RUST_LOG"}
        command = [sys.executable, "-c", ROUTE, self.endpoint, str(self.keys)]
        with self.errors.open("wb") as errors, subprocess.Popen(command, stderr=errors, env=environment) as router:
            try:
                yield
            finally:
                router.terminate()
                router.wait(PATIENCE_S)

    @contextlib.asynccontextmanager
    async def joined(self, party: str) -> AsyncIterator[LiveBus]:
        """Join as soon as there is a router."""
        deadline_s = time.monotonic() + PATIENCE_S
        async with contextlib.AsyncExitStack() as stack:
            while True:
                try:
                    bus = await stack.enter_async_context(open_bus(self.of(party)))
                    break
                except BusError:
                    assert time.monotonic() < deadline_s, self.errors.read_text()
                await asyncio.sleep(0.1)
            yield bus

    async def without_certificate(self) -> None:
        """Come with the authority's certificate alone, as whoever has found it."""
        values = json.loads(self.made[U1])["transport"]["link"]["tls"]
        context = ssl.create_default_context(cadata=base64.b64decode(values["root_ca_certificate_base64"]).decode())
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", self.port, ssl=context)
            await reader.read()
            writer.close()

    @property
    def port(self) -> int:
        return int(self.endpoint.rpartition(":")[2])


class Told:
    """What the routers tell, taken off the bus."""

    def __init__(self, bus: LiveBus, errors: Path) -> None:
        self.latest: dict[str, Refusals] = {}
        self._errors = errors
        bus.subscribe(refusals_key(SWARM), self.take)

    def take(self, key: str, payload: bytes) -> None:
        self.latest[key] = decode_refusals(payload)

    async def until(self, condition: Callable[[Refusals], Any]) -> Refusals:
        """Return the sum of what they tell as soon as it is so."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not self.latest or not condition(sum(self.latest.values(), Refusals())):
            assert time.monotonic() < deadline_s, (self.latest, self._errors.read_text())
            await asyncio.sleep(0.02)
        return sum(self.latest.values(), Refusals())


async def heard(bus: LiveBus, key: str, say: Callable[[], None]) -> None:
    """Say something until it is heard: who subscribes becomes known a little later."""
    came = asyncio.Event()
    bus.subscribe(key, lambda _key, _payload: came.set())
    async with asyncio.timeout(PATIENCE_S):
        while not came.is_set():
            say()
            await asyncio.sleep(0.02)


@pytest.mark.slow
async def test_a_real_router_counts_strangers_and_whoever_oversteps_and_nobody_else(tmp_path: Path) -> None:
    closed, north = Closed(tmp_path), NodeKeys(SWARM, "north")
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(closed.routed())
        service, operator, uav, node = [
            await stack.enter_async_context(closed.joined(party)) for party in (SERVICE, OPERATOR, U1, NORTH)
        ]
        told = Told(operator, closed.errors)
        # what everybody may do counts nothing
        node.declare_alive(north.alive)
        service.watch_alive(NodeKeys(SWARM).alive, lambda *_: None)
        service.serve(KEYS.control, lambda _: b"done")
        await heard(service, KEYS.every_bearings, lambda: uav.put_latest(KEYS.bearings("U1"), b"own"))
        await heard(uav, KEYS.clock_ping("U1"), lambda: service.put_latest(KEYS.clock_ping("U1"), b"ping"))
        await heard(service, north.beat, lambda: node.put_latest(north.beat, b"beat", urgent=True))
        await heard(node, north.grant, lambda: service.put_reliably(north.grant, b"grant"))
        await heard(operator, KEYS.progress, lambda: service.put_history(KEYS.progress, b"progress"))
        assert await operator.ask(KEYS.control, b"hold") == b"done"
        told.latest.clear()
        assert await told.until(lambda _: True) == Refusals()
        # strangers of every kind that gets as far as the router
        over_the_wire = [name for name in STRANGERS if name not in NO_FURTHER]
        for name in over_the_wire:
            with pytest.raises(BusError):
                async with open_bus(STRANGERS[name](closed)):  # type: ignore[no-untyped-call]
                    pass
        await closed.without_certificate()
        assert await told.until(lambda all_: all_.total >= len(over_the_wire) + 1) == Refusals(
            strangers=len(over_the_wire) + 1
        )
        # a UAV that speaks for another, commands, and listens
        for _ in range(3):
            uav.put_latest(KEYS.bearings("U2"), b"forged")
        uav.put_latest("bearing-relay/eight/uav/U2/a\nb", b"forged")
        with pytest.raises(BusError, match="is not answered"):
            await uav.ask(KEYS.control, b"abort")
        uav.subscribe(KEYS.every_bearings, lambda *_: None)
        node.put_latest(KEYS.bearings("U2"), b"forged")
        expected = Refusals(len(over_the_wire) + 1, 0, 0, {U1: 4, NORTH: 1}, {U1: 2})
        assert await told.until(lambda all_: all_.total >= expected.total) == expected
    assert "refused on the bus" in closed.errors.read_text()
    assert "not understood" not in closed.errors.read_text()


NO_FURTHER = ("who knows the authority, without a certificate", "with another's certificate and no key to it")
"""zenoh's own client does not even try."""
