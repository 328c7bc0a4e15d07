"""A bus closed to strangers, over a real router on loopback: who is refused, who may say what, who may command."""

import asyncio
import base64
import contextlib
import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh

from drivers.bus.certificates import LONGEST_NAME, Authority, now
from drivers.bus.keys import SwarmKeys
from drivers.bus.node_keys import NodeKeys
from drivers.bus.refusals import refusals_key
from drivers.bus.security import (
    OPERATOR,
    ROUTER,
    SERVICE,
    KeyedEndpoint,
    access_control,
    configurations,
    host_of,
    node_party,
    rights_of_all,
    site_router,
    uav_party,
    with_keys,
)
from drivers.bus.session import BusEndpoint, LiveBus, open_bus, require_closed
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port

PATIENCE_S = 5.0
KEYS = SwarmKeys("eight")
U1, U2, NAMED_OPERATOR = uav_party("U1"), uav_party("U2"), uav_party(OPERATOR)
UAVS = ["U1", "U2", OPERATOR]


def authority() -> Authority:
    return Authority(KEYS.swarm, now(), valid_days=2)


class Closed:
    """A router on loopback with keys for a swarm, and sessions of its parties."""

    def __init__(self, stack: contextlib.AsyncExitStack) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
        self.made = configurations(KEYS.swarm, UAVS, self.endpoint, authority())
        self._stack = stack

    def of(self, party: str) -> KeyedEndpoint:
        return KeyedEndpoint(self.endpoint, "router" if party == ROUTER else "client", self.made[party])

    async def join(self, party: str):
        return await self._stack.enter_async_context(open_bus(self.of(party)))


@pytest.fixture
async def closed():
    async with contextlib.AsyncExitStack() as stack:
        closed = Closed(stack)
        await closed.join(ROUTER)
        yield closed


class Inbox:
    def __init__(self) -> None:
        self.samples: list[tuple[str, bytes]] = []

    def take(self, key: str, payload: bytes) -> None:
        self.samples.append((key, payload))

    async def until_heard(self, say, sample: tuple[str, bytes]) -> None:
        """Say something again and again until it is heard here: who subscribes becomes known a little later."""
        async with asyncio.timeout(PATIENCE_S):
            while sample not in self.samples:
                say()
                await asyncio.sleep(0.01)


async def answered(bus, key: str, payload: bytes) -> bytes:
    """Return the answer once the queryable is known."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return await bus.ask(key, payload)
        except BusError:
            assert time.monotonic() < deadline_s, f"{key} is not answered"
            await asyncio.sleep(0.01)


async def fetched(bus: LiveBus, key_expression: str) -> dict[str, bytes]:
    """Return what is remembered once anything is: who remembers it becomes known a little later."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (values := await bus.fetch(key_expression)):
        assert time.monotonic() < deadline_s, f"nobody remembers {key_expression}"
    return values


def with_link(endpoint: KeyedEndpoint, **tls: object) -> KeyedEndpoint:
    """Return an endpoint whose keys are tampered with; None takes one out."""
    values = json.loads(endpoint.keys)
    own = values["transport"]["link"]["tls"] | tls
    values["transport"]["link"]["tls"] = {name: value for name, value in own.items() if value is not None}
    return replace(endpoint, keys=json.dumps(values))


FOREIGN = configurations("eight", UAVS, "tls/127.0.0.1:7447", authority())
FOREIGN_TLS = json.loads(FOREIGN[OPERATOR])["transport"]["link"]["tls"]
STRANGERS = {
    "without any keys, over tls": lambda closed: BusEndpoint(closed.endpoint),
    "without any keys, over tcp": lambda closed: BusEndpoint(closed.endpoint.replace("tls/", "tcp/")),
    "with the keys of another swarm of the same name": lambda closed: replace(
        closed.of(OPERATOR), keys=FOREIGN[OPERATOR]
    ),
    "who knows the authority, with a certificate of his own": lambda closed: with_link(
        closed.of(OPERATOR),
        connect_private_key_base64=FOREIGN_TLS["connect_private_key_base64"],
        connect_certificate_base64=FOREIGN_TLS["connect_certificate_base64"],
    ),
    "who knows the authority, without a certificate": lambda closed: with_link(
        closed.of(OPERATOR), connect_private_key_base64=None, connect_certificate_base64=None
    ),
    "with another's certificate and no key to it": lambda closed: with_link(
        closed.of(OPERATOR), connect_private_key_base64=FOREIGN_TLS["connect_private_key_base64"]
    ),
}


@pytest.mark.parametrize("stranger", STRANGERS)
async def test_a_stranger_is_refused(closed: Closed, stranger: str) -> None:
    began_s = time.monotonic()
    with pytest.raises(BusError, match="cannot be opened"):
        async with open_bus(STRANGERS[stranger](closed)):
            pass
    assert time.monotonic() - began_s < PATIENCE_S
    assert (await closed.join(OPERATOR)).connected()


async def test_a_uav_says_its_own_bearings_and_clock_and_hears_what_is_for_it(closed: Closed) -> None:
    service, uav, at_service, at_uav = await closed.join(SERVICE), await closed.join(U1), Inbox(), Inbox()
    service.subscribe(KEYS.every_bearings, at_service.take)
    service.subscribe(KEYS.every_clock_pong, at_service.take)
    uav.subscribe(KEYS.clock_ping("U1"), at_uav.take)
    uav.subscribe(KEYS.emission("U1"), at_uav.take)
    for key in (KEYS.bearings("U1"), KEYS.clock_pong("U1")):
        await at_service.until_heard(lambda key=key: uav.put_latest(key, b"own", urgent=True), (key, b"own"))
    for key in (KEYS.clock_ping("U1"), KEYS.emission("U1")):
        await at_uav.until_heard(lambda key=key: service.put_reliably(key, b"on"), (key, b"on"))
    assert (await uav.fetch(KEYS.emission("U1"))) == {KEYS.emission("U1"): b"on"}


FORGED = [
    KEYS.bearings("U2"),
    KEYS.every_bearings,
    KEYS.clock_pong("U2"),
    KEYS.clock_ping("U1"),
    KEYS.position("U1"),
    KEYS.emission("U1"),
    KEYS.emission("U2"),
    KEYS.progress,
    KEYS.setup,
    KEYS.state,
    KEYS.events,
    KEYS.control,
]


async def test_a_uav_speaks_for_nobody_else_whoever_listens(closed: Closed) -> None:
    service, operator, uav = [await closed.join(party) for party in (SERVICE, OPERATOR, U1)]
    heard = Inbox()
    for listener in (service, operator):
        for expression in ("bearing-relay/eight/**", KEYS.state, KEYS.events):
            listener.subscribe(expression, heard.take)
    own = (KEYS.bearings("U1"), b"own")
    await heard.until_heard(lambda: uav.put_latest(*own), own)
    for key in FORGED:
        uav.put_latest(key, b"forged")
        uav.put_reliably(key, b"forged")
    heard.samples.clear()
    last = (KEYS.bearings("U1"), b"after all that")
    await heard.until_heard(lambda: uav.put_latest(*last), last)
    assert {payload for _, payload in heard.samples} <= {b"own", b"after all that"}
    told = Inbox()
    operator.subscribe("bearing-relay/eight/**", told.take)
    await told.until_heard(lambda: service.put_latest(KEYS.bearings("U2"), b"simulated"), (FORGED[0], b"simulated"))


async def test_a_uav_hears_nothing_of_another(closed: Closed) -> None:
    service, uav, other, heard = await closed.join(SERVICE), await closed.join(U1), await closed.join(U2), Inbox()
    for expression in ("bearing-relay/eight/**", KEYS.every_bearings, KEYS.emission("U2"), KEYS.progress, KEYS.state):
        uav.subscribe(expression, heard.take)
    uav.subscribe(KEYS.clock_ping("U1"), heard.take)
    known = (KEYS.clock_ping("U1"), b"before all that")
    await heard.until_heard(lambda: service.put_latest(*known), known)
    at_service = Inbox()
    service.subscribe(KEYS.every_bearings, at_service.take)
    said = (KEYS.bearings("U2"), b"own")
    await at_service.until_heard(lambda: other.put_latest(*said), said)
    for key in (KEYS.emission("U2"), KEYS.progress, KEYS.position("U2"), KEYS.state):
        service.put_latest(key, b"not for it")
    meant = (KEYS.clock_ping("U1"), b"for it")
    await heard.until_heard(lambda: service.put_latest(*meant), meant)
    assert set(heard.samples) == {known, meant}


async def test_the_operator_commands_and_nobody_else(closed: Closed) -> None:
    service, operator = await closed.join(SERVICE), await closed.join(OPERATOR)
    asked: list[bytes] = []

    def answer(payload: bytes) -> bytes:
        asked.append(payload)
        return b"done"

    service.serve(KEYS.control, answer)
    assert await answered(operator, KEYS.control, b"hold") == b"done"
    for party in (U1, NAMED_OPERATOR, SERVICE):
        bus = await closed.join(party)
        for key in (KEYS.control, "bearing-relay/eight/relay/*", "**"):
            with pytest.raises(BusError, match="is not answered"):
                await bus.ask(key, b"abort")
    assert await operator.ask(KEYS.control, b"resume") == b"done"
    assert set(asked) == {b"hold", b"resume"}


async def test_the_operator_sees_the_run_and_says_no_bearings(closed: Closed) -> None:
    service, operator, heard = await closed.join(SERVICE), await closed.join(OPERATOR), Inbox()
    service.subscribe(KEYS.every_bearings, heard.take)
    seen = Inbox()
    operator.subscribe(KEYS.state, seen.take)
    service.put_reliably(KEYS.setup, b"setup")
    service.put_history(KEYS.progress, b"first")
    service.serve(KEYS.events, lambda _: b"events")
    await seen.until_heard(lambda: service.put_latest(KEYS.state, b"state"), (KEYS.state, b"state"))
    assert await answered(operator, KEYS.events, b"") == b"events"
    assert await operator.fetch(SwarmKeys("*").setup) == {KEYS.setup: b"setup"}
    assert await operator.fetch_history(KEYS.progress) == [b"first"]
    operator.put_latest(KEYS.bearings("U1"), b"forged")
    assert await operator.ask(KEYS.events, b"") == b"events"  # which came after that
    uav, last = await closed.join(U1), (KEYS.bearings("U1"), b"own")
    await heard.until_heard(lambda: uav.put_latest(*last), last)
    assert set(heard.samples) == {last}


@pytest.mark.parametrize("listener", [SERVICE, OPERATOR, U1])
async def test_a_router_alone_tells_what_was_refused_and_service_and_operator_alone_hear_it(listener: str) -> None:
    async with contextlib.AsyncExitStack() as stack:
        closed, heard = Closed(stack), Inbox()
        router, listening = await closed.join(ROUTER), await closed.join(listener)
        others = [await closed.join(party) for party in (SERVICE, OPERATOR, U1, U2) if party != listener]
        listening.subscribe(refusals_key("eight"), heard.take)
        listening.subscribe(KEYS.clock_ping("U1"), heard.take)
        told, last = (refusals_key("eight", "a1"), b"told"), (KEYS.clock_ping("U1"), b"ping")
        expected = {last} if listener == U1 else {told, last}

        def all_say() -> None:
            for bus in others:
                bus.put_latest(refusals_key("eight", "b2"), b"forged")
            for key, payload in (told, last):
                router.put_latest(key, payload)

        for sample in expected:
            await heard.until_heard(all_say, sample)
        for bus in others:
            with pytest.raises(BusError, match="is not answered"):
                await bus.ask(KEYS.control, b"hold")  # the router has had all they said when it says so
        after = (KEYS.clock_ping("U1"), b"after all that")
        await heard.until_heard(lambda: router.put_latest(*after), after)
        assert set(heard.samples) == {*expected, after}


async def test_a_uav_answers_nobody_in_the_place_of_the_service(closed: Closed) -> None:
    operator, uav, service = await closed.join(OPERATOR), await closed.join(U1), await closed.join(SERVICE)
    uav.serve(KEYS.control, lambda _: b"all is well")
    uav.put_reliably(KEYS.setup, b"another run")
    heard, after = Inbox(), (KEYS.bearings("U1"), b"after that")
    service.subscribe(KEYS.every_bearings, heard.take)
    await heard.until_heard(lambda: uav.put_latest(*after), after)
    service.serve(KEYS.events, lambda _: b"events")
    assert await answered(operator, KEYS.events, b"") == b"events"
    with pytest.raises(BusError, match="nobody serves it"):
        await operator.ask(KEYS.control, b"hold")
    assert await operator.fetch(KEYS.setup) == {}


async def test_who_has_keys_but_no_rights_any_more_can_do_nothing(closed: Closed) -> None:
    async with contextlib.AsyncExitStack() as stack:
        left = Closed(stack)
        router = json.loads(left.made[ROUTER])
        router["access_control"] = access_control(KEYS.swarm, rights_of_all(KEYS.swarm, ["U1"]))
        left.made[ROUTER] = json.dumps(router)
        await left.join(ROUTER)
        service, lost, uav, heard = await left.join(SERVICE), await left.join(U2), await left.join(U1), Inbox()
        service.subscribe(KEYS.every_bearings, heard.take)
        last = (KEYS.bearings("U1"), b"own")
        await heard.until_heard(lambda: uav.put_latest(*last), last)
        for _ in range(20):
            lost.put_latest(KEYS.bearings("U2"), b"lost")
        with pytest.raises(BusError, match="is not answered"):
            await lost.ask(KEYS.control, b"abort")  # the router has had all that when it says so
        after = (KEYS.bearings("U1"), b"after all that")
        await heard.until_heard(lambda: uav.put_latest(*after), after)
        assert set(heard.samples) == {last, after}


async def test_nobody_is_taken_for_the_router_with_a_uavs_keys(closed: Closed) -> None:
    stolen = json.loads(closed.made[U1])["transport"]["link"]["tls"]
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    false = with_link(
        replace(closed.of(ROUTER), endpoint=endpoint),
        listen_private_key_base64=stolen["connect_private_key_base64"],
        listen_certificate_base64=stolen["connect_certificate_base64"],
    )
    async with open_bus(false):
        with pytest.raises(BusError, match="cannot be opened"):
            async with open_bus(replace(closed.of(OPERATOR), endpoint=endpoint)):
                pass


async def test_nobody_is_taken_for_the_router_with_a_router_s_keys_of_another_place() -> None:
    vouching, endpoint = authority(), f"tls/127.0.0.1:{free_tcp_port()}"
    made = configurations(KEYS.swarm, UAVS, endpoint, vouching)
    elsewhere = vouching.identity(ROUTER, ("10.0.0.1",))
    false = with_link(
        KeyedEndpoint(endpoint, "router", made[ROUTER]),
        listen_private_key_base64=base64.b64encode(elsewhere.key).decode(),
        listen_certificate_base64=base64.b64encode(elsewhere.certificate).decode(),
    )
    async with open_bus(false):
        with pytest.raises(BusError, match="cannot be opened"):
            async with open_bus(KeyedEndpoint(endpoint, "client", made[OPERATOR])):
                pass


async def test_simulated_sensors_and_the_operator_are_told_who_transmits_and_the_former_their_faults(
    closed: Closed,
) -> None:
    service, sensors, operator = [await closed.join(party) for party in (SERVICE, SERVICE, OPERATOR)]
    service.put_reliably(KEYS.emission("U1"), b"on")
    service.put_reliably(KEYS.sensor_fault("U1"), b"stuck")
    for bus in (sensors, operator):
        assert await fetched(bus, KEYS.every_emission) == {KEYS.emission("U1"): b"on"}
    assert await fetched(sensors, KEYS.every_sensor_fault) == {KEYS.sensor_fault("U1"): b"stuck"}


ROUTER_OF_ANYBODY = """
import sys, zenoh
with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
    print("up", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
def test_any_zenoh_program_takes_part_with_the_file_alone(tmp_path: Path) -> None:
    made = configurations(KEYS.swarm, ["U1"], f"tls/localhost:{free_tcp_port()}", authority())
    for party, text in made.items():
        (tmp_path / f"{party}.json5").write_text(text)
    arguments = [sys.executable, "-c", ROUTER_OF_ANYBODY, str(tmp_path / f"{ROUTER}.json5")]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as router:
        assert router.stdout is not None
        assert router.stdout.readline() == "up\n"
        uav, service = (zenoh.Config.from_file(str(tmp_path / f"{party}.json5")) for party in (U1, SERVICE))
        with zenoh.open(service) as hearing, zenoh.open(uav) as speaking:
            heard = hearing.declare_subscriber(KEYS.every_bearings)
            deadline_s = time.monotonic() + PATIENCE_S
            while (sample := heard.try_recv()) is None:
                assert time.monotonic() < deadline_s
                speaking.put(KEYS.bearings("U2"), b"forged")
                speaking.put(KEYS.bearings("U1"), b"own")
                time.sleep(0.01)
            assert sample.payload.to_bytes() == b"own"
        router.communicate(timeout=PATIENCE_S)
        assert router.returncode == 0


def test_every_party_has_a_name_that_no_uav_can_take() -> None:
    called = [SERVICE, OPERATOR, ROUTER, "uav.U1", "U1", "node.U1", "router.U1"]
    names = [rights.name for rights in rights_of_all("eight", called, called)]
    names += [ROUTER, *map(site_router, called)]
    assert len(set(names)) == len(names) == 3 + 3 * len(called)


def test_no_rule_of_a_uav_names_another() -> None:
    for rights in rights_of_all("eight", ["U1", "U2"])[2:]:
        own = rights.name.removeprefix("uav.")
        named = (*rights.says, *rights.hears, *rights.asks, *rights.answers)
        assert named
        assert all(f"/uav/{own}/" in key and "*" not in key for key in named)


def test_what_the_router_lets_a_uav_do_names_no_other_but_for_who_listens_and_answers() -> None:
    rules = access_control("eight", rights_of_all("eight", ["U1", "U2"], ["north"]))["rules"]
    own = {rule["id"].removeprefix(f"{U1} "): rule for rule in rules if rule["id"].startswith(f"{U1} ")}
    told = own.pop("is told")
    assert (told["flows"], told["messages"]) == (["egress"], ["declare_subscriber", "declare_queryable"])
    assert own.keys() == {"says", "listens", "asks", "hears", "is answered"}
    assert all("/uav/U1/" in key and "*" not in key for rule in own.values() for key in rule["key_exprs"])


def test_a_link_node_speaks_for_itself_and_commands_nobody() -> None:
    north = {rights.name: rights for rights in rights_of_all("eight", ["U1"], ["north", "south"])}[node_party("north")]
    own = NodeKeys("eight", "north")
    assert set(north.says) == {own.beat, own.reports, own.telemetry, KEYS.every_clock_ping}
    assert set(north.hears) == {own.grant, own.orders, KEYS.every_bearings, KEYS.every_clock_pong}
    assert (north.asks, north.answers, north.lives, north.watches) == ((), (own.reports,), (own.alive,), ())


def test_every_file_opens_nothing_but_mutual_tls_and_outlives_its_certificate_in_flight() -> None:
    south = {"south": "tls/10.0.0.2:7447"}
    made = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority(), ["south"], south)
    for text in made.values():
        values = json.loads(text)
        assert values["scouting"] == {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
        assert values["transport"]["shared_memory"] == {"enabled": False}
        assert values["transport"]["link"]["protocols"] == ["tls"]
        tls = values["transport"]["link"]["tls"]
        assert (tls["enable_mtls"], tls["verify_name_on_connect"]) == (True, True)
        assert tls["close_link_on_expiration"] is False


def test_an_endpoint_with_keys_is_closed_to_strangers_wherever_it_is() -> None:
    made = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority())
    require_closed(KeyedEndpoint("tls/10.0.0.1:7447", "client", made[U1]))


def test_only_the_router_s_file_has_the_rights_and_nobody_has_another_s_key() -> None:
    made = configurations("eight", ["U1", "U2"], "tls/10.0.0.1:7447", authority())
    assert [party for party, text in made.items() if "access_control" in text] == [ROUTER]
    links = [json.loads(text)["transport"]["link"]["tls"] for text in made.values()]
    keys = [value for tls in links for name, value in tls.items() if "private_key" in name]
    assert len(set(keys)) == len(keys) == len(made) == 5
    assert len({tls["root_ca_certificate_base64"] for tls in links}) == 1
    assert b"PRIVATE" not in base64.b64decode(links[0]["root_ca_certificate_base64"])


def test_a_key_is_not_shown() -> None:
    made = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority())
    shown = repr(KeyedEndpoint("tls/10.0.0.1:7447", "client", made[U1]))
    assert "BEGIN" not in shown
    assert "private" not in shown
    assert repr(authority().identity("somebody")) == "Identity(not shown)"


@pytest.mark.parametrize(
    ("endpoint", "host"),
    [
        ("tls/10.0.0.1:7447", "10.0.0.1"),
        ("tls/ground.example:7447", "ground.example"),
        ("tls/[fe80::1]:7447", "fe80::1"),
    ],
)
def test_an_endpoint_names_its_host(endpoint: str, host: str) -> None:
    assert host_of(endpoint) == host
    assert configurations("eight", ["U1"], endpoint, authority()).keys() == {ROUTER, SERVICE, OPERATOR, U1}


@pytest.mark.parametrize("endpoint", ["tcp/10.0.0.1:7447", "tls/10.0.0.1", "tls/:7447", "tls/a:99999", "tls/a b:1", ""])
def test_an_endpoint_that_cannot_be_closed_is_refused(endpoint: str) -> None:
    with pytest.raises(BusError, match="write tls/HOST:PORT"):
        configurations("eight", ["U1"], endpoint, authority())


def test_a_name_that_fits_into_no_certificate_is_refused() -> None:
    with pytest.raises(BusError, match="more than 64 characters"):
        configurations("eight", ["U" * LONGEST_NAME], "tls/10.0.0.1:7447", authority())
    assert configurations("e" * 100, ["U1"], "tls/10.0.0.1:7447", authority())


def test_without_a_file_an_endpoint_stays_as_it_is() -> None:
    endpoint = BusEndpoint("tcp/127.0.0.1:7447")
    assert with_keys(endpoint, None) is endpoint


def test_a_file_of_keys_is_read(tmp_path: Path) -> None:
    made = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority())
    file = tmp_path / "U1.json5"
    file.write_text(made[U1])
    file.chmod(0o600)
    assert with_keys(BusEndpoint("tls/10.0.0.1:7447"), file) == KeyedEndpoint("tls/10.0.0.1:7447", "client", made[U1])


def test_the_router_s_file_says_of_which_swarm_it_is_and_who_has_rights(tmp_path: Path) -> None:
    text = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority())[ROUTER]
    endpoint = KeyedEndpoint("tls/10.0.0.1:7447", "router", text)
    assert endpoint.swarm == "eight"
    assert endpoint.parties == {SERVICE, OPERATOR, U1}
    values = json.loads(text)
    del values["metadata"]  # as files were before
    file = tmp_path / "router.json5"
    file.touch(mode=0o600)
    file.write_text(json.dumps(values))
    before = with_keys(BusEndpoint("tls/10.0.0.1:7447", "router"), file)
    assert isinstance(before, KeyedEndpoint)
    assert before.swarm is None


@pytest.mark.parametrize(
    ("role", "endpoint", "mode", "text", "says"),
    [
        ("client", "tls/10.0.0.1:7447", 0o644, "made", "can be read by others: chmod 600"),
        ("client", "tls/10.0.0.1:7447", 0o640, "made", "can be read by others: chmod 600"),
        ("client", "tls/10.0.0.1:7447", 0o604, "made", "can be read by others: chmod 600"),
        ("client", "tls/10.0.0.1:7447", 0o620, "made", "can be read by others: chmod 600"),
        ("client", "tcp/10.0.0.1:7447", 0o600, "made", "write tls/HOST:PORT"),
        ("router", "tls/10.0.0.1:7447", 0o600, "made", "keys of a client, and those of a router"),
        ("router", "tls/10.0.0.1:7447", 0o600, "without rights", "says nobody's rights"),
        ("router", "tls/10.0.0.1:7447", 0o600, "with rights of nobody", "says nobody's rights"),
        ("router", "tls/10.0.0.1:7447", 0o600, "with rights not kept to", "or not to keep to them"),
        ("router", "tls/10.0.0.1:7447", 0o600, "with all else allowed", "or not to keep to them"),
        ("client", "tls/10.0.0.1:7447", 0o600, "without rights", "keys of a router, and those of a client"),
        ("router", "tls/10.0.0.1:7447", 0o600, "of no swarm", "holds no keys of a bus"),
        ("client", "tls/10.0.0.1:7447", 0o600, "{}", "holds no keys of a bus"),
        ("client", "tls/10.0.0.1:7447", 0o600, "[1]", "holds no keys of a bus"),
        ("client", "tls/10.0.0.1:7447", 0o600, "\udcff", "holds no keys of a bus"),
        (
            "client",
            "tls/10.0.0.1:7447",
            0o600,
            '{"mode": "client", "transport": {"link": {}}}',
            "holds no keys of a bus",
        ),
        ("client", "tls/10.0.0.1:7447", 0o600, None, "cannot be read: No such file"),
    ],
)
def test_a_file_that_cannot_be_used_is_said(
    tmp_path: Path, role: str, endpoint: str, mode: int, text: str | None, says: str
) -> None:
    made = configurations("eight", ["U1"], "tls/10.0.0.1:7447", authority())
    texts = {
        "made": made[U1],
        "without rights": made[ROUTER].replace('"access_control"', '"nothing"'),
        "with rights of nobody": made[ROUTER].replace('"subjects": [', '"of_old": ['),
        "with rights not kept to": re.sub(r'("access_control": *\{\s*"enabled": *)true', r"\1false", made[ROUTER]),
        "with all else allowed": re.sub(r'("default_permission": *)"deny"', r'\1"allow"', made[ROUTER]),
        "of no swarm": made[ROUTER].replace('"swarm": "eight"', '"swarm": "eight/**"'),
    }
    file = tmp_path / "keys.json5"
    if text is not None:
        file.write_text(texts.get(text, text), errors="surrogateescape")
        file.chmod(mode)
    with pytest.raises(BusError, match=says):
        with_keys(BusEndpoint(endpoint, role), file)
