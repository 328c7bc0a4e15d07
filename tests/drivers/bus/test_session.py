"""The bus over a real router process on loopback, and what becomes of it when the router goes."""

import asyncio
import os
import socket
import subprocess
import sys
import time

import pytest

from drivers.bus.session import ANSWERED_WITHIN_S, HISTORY_KEPT, BusEndpoint, open_bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port, process_group

PATIENCE_S = 5.0


class Router:
    """A router process that the test may kill and start again."""

    def __init__(self, group):
        self.endpoint = BusEndpoint(f"tcp/127.0.0.1:{free_tcp_port()}")
        self._group = group

    async def start(self):
        arguments = ["-m", "drivers.bus.router", self.endpoint.endpoint, "--parent-pid", str(os.getpid())]
        await self._group.start("router", arguments)
        deadline_s = time.monotonic() + 30.0
        while True:
            self._group.require_running("router")
            try:
                async with open_bus(self.endpoint):
                    return
            except BusError:
                assert time.monotonic() < deadline_s, "the router did not start"
                await asyncio.sleep(0.05)

    async def kill(self):
        process = self._group.processes["router"]
        process.kill()
        await process.wait()


@pytest.fixture
async def group(tmp_path):
    async with process_group(tmp_path) as group:
        yield group


@pytest.fixture
async def router(group):
    router = Router(group)
    await router.start()
    return router


class Inbox:
    """What a subscriber got, in order."""

    def __init__(self):
        self.samples = []
        self._came = asyncio.Event()

    def take(self, key, payload):
        asyncio.get_running_loop()  # a handler runs on the event loop, or this raises
        self.samples.append((key, payload))
        self._came.set()

    async def until(self, holds):
        async with asyncio.timeout(PATIENCE_S):
            while not holds(self.samples):
                self._came.clear()
                await self._came.wait()

    async def until_ready(self, put, holds=bool):
        """Put until the first sample arrives: a subscription reaches the other sessions a little later.

        Or until something else holds: on a busy machine any one sample may be lost.
        """
        async with asyncio.timeout(PATIENCE_S):
            while not holds(self.samples):
                put()
                await asyncio.sleep(0.01)


async def until(holds, timeout_s=PATIENCE_S):
    """Return how long it took until something held, s, but for what a busy machine took away between two looks."""
    started_s, looks = time.monotonic(), 0
    while not holds():
        assert time.monotonic() - started_s < timeout_s, "it never held"
        await asyncio.sleep(0.01)
        looks += 1
    return looks * 0.01


async def fetched(bus, key_expression, wanted):
    """Return whether fetching yields what is wanted, within a time: a queryable becomes known a little later."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if await bus.fetch(key_expression) == wanted:
            return True
        await asyncio.sleep(0.01)
    return False


@pytest.mark.slow
async def test_what_one_puts_every_subscriber_of_a_matching_key_gets_in_order(router):
    async with open_bus(router.endpoint) as sender, open_bus(router.endpoint) as receiver:
        inbox, other = Inbox(), Inbox()
        receiver.subscribe("t/*/bearings", inbox.take)
        receiver.subscribe("t/U1/emission", other.take)
        await inbox.until_ready(lambda: sender.put_latest("t/U9/bearings", b"hello"))
        for number in range(50):
            sender.put_latest("t/U1/bearings", b"%d" % number, urgent=True)
            await asyncio.sleep(0)
        last = ("t/U1/bearings", b"50")
        await inbox.until_ready(lambda: sender.put_latest(*last, urgent=True), lambda samples: last in samples)
        got = [int(payload) for key, payload in inbox.samples if key == "t/U1/bearings"]
        assert got == sorted(got)
        assert len(set(got)) > 10
        assert other.samples == []
        assert sender.connected()
        assert receiver.connected()


@pytest.mark.slow
async def test_everything_put_reliably_arrives(router):
    async with open_bus(router.endpoint) as sender, open_bus(router.endpoint) as receiver:
        inbox = Inbox()
        receiver.subscribe("t/progress", inbox.take)
        await inbox.until_ready(lambda: sender.put_reliably("t/progress", b"-1"))
        for number in range(2000):
            sender.put_reliably("t/progress", b"%d" % number)
        await inbox.until(lambda samples: samples[-1][1] == b"1999")
        assert [int(payload) for _, payload in inbox.samples if payload != b"-1"] == list(range(2000))


@pytest.mark.slow
async def test_a_late_joiner_fetches_the_last_value_of_every_key(router):
    async with open_bus(router.endpoint) as sender:
        for value in (b"off", b"on"):
            sender.put_reliably("t/uav/U1/emission", value)
        sender.put_reliably("t/uav/L0/emission", b"on")
        sender.put_latest("t/uav/U2/emission", b"not remembered")
        async with open_bus(router.endpoint) as late:
            wanted = {"t/uav/U1/emission": b"on", "t/uav/L0/emission": b"on"}
            assert await fetched(late, "t/uav/*/emission", wanted)
            assert await late.fetch("t/uav/*/position") == {}


@pytest.mark.slow
async def test_a_late_joiner_fetches_the_whole_history_in_order_and_then_hears_the_rest(router):
    async with open_bus(router.endpoint) as sender, open_bus(router.endpoint) as late:
        for number in range(HISTORY_KEPT + 10):
            sender.put_history("t/progress", b"%d" % number)
        deadline_s = time.monotonic() + PATIENCE_S
        while not (fetched := await late.fetch_history("t/progress")):
            assert time.monotonic() < deadline_s
        assert [int(payload) for payload in fetched] == list(range(10, HISTORY_KEPT + 10))
        inbox = Inbox()
        late.subscribe("t/progress", inbox.take)
        await inbox.until_ready(lambda: sender.put_history("t/progress", b"-1"))
        assert (await late.fetch_history("t/progress"))[-1] == b"-1"
        assert await late.fetch_history("t/other") == []


async def answered(bus, key, payload):
    """Return the answer to a query, asked again until the one who serves it is known."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return await bus.ask(key, payload)
        except BusError:
            assert time.monotonic() < deadline_s
            await asyncio.sleep(0.01)


@pytest.mark.slow
async def test_a_query_is_answered_on_the_event_loop_and_only_its_asker_hears_it(router):
    async with open_bus(router.endpoint) as server, open_bus(router.endpoint) as asker:
        asked, overheard = [], Inbox()

        def answer(payload):
            asyncio.get_running_loop()
            asked.append(payload)
            return payload.upper()

        server.serve("t/control", answer)
        server.subscribe("t/*", overheard.take)
        assert await answered(asker, "t/control", b"hold") == b"HOLD"
        replies = await asyncio.gather(*(asker.ask("t/control", b"%d" % number) for number in range(20)))
        assert sorted(replies, key=int) == [b"%d" % number for number in range(20)]
        assert await asker.ask("t/control", b"") == b""
        assert len(asked) == 22
        assert overheard.samples == []


@pytest.mark.slow
async def test_without_anybody_who_serves_it_a_query_is_an_error_at_once(router):
    async with open_bus(router.endpoint) as asker:
        started_s = time.monotonic()
        with pytest.raises(BusError, match="t/control is not answered: nobody serves it"):
            await asker.ask("t/control", b"hold")
        assert time.monotonic() - started_s < ANSWERED_WITHIN_S


@pytest.mark.slow
async def test_a_failing_answer_is_an_error_for_the_asker_and_the_next_one_is_answered(router):
    async with open_bus(router.endpoint) as server, open_bus(router.endpoint) as asker:
        complaints = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context["exception"]))
        server.serve("t/control", lambda payload: b"%d" % (1 // len(payload)))
        assert await answered(asker, "t/control", b"1") == b"1"
        with pytest.raises(BusError, match="answering it failed"):
            await asker.ask("t/control", b"")
        assert await asker.ask("t/control", b"1") == b"1"
        assert [type(complaint) for complaint in complaints] == [ZeroDivisionError]


def stick_for(duration_s):
    """Let the event loop be stuck."""
    time.sleep(duration_s)


@pytest.mark.slow
async def test_what_could_not_be_answered_in_time_is_not_done_later_either(router):
    async with open_bus(router.endpoint) as server, open_bus(router.endpoint) as asker:
        done = []
        server.serve("t/control", lambda payload: done.append(payload) or payload)
        await answered(asker, "t/control", b"ready")
        asking = asyncio.create_task(asker.ask("t/control", b"resume"))
        await asyncio.sleep(0.0)
        stick_for(ANSWERED_WITHIN_S + 0.3)
        with pytest.raises(BusError, match="nothing was done"):
            await asking
        assert done == [b"ready"]


@pytest.mark.slow
async def test_a_killed_router_is_noticed_within_a_second_puts_raise_nothing_and_closing_does_not_hang(router):
    opened = open_bus(router.endpoint)
    bus = await opened.__aenter__()
    try:
        bus.subscribe("t/*", lambda key, payload: None)
        bus.put_reliably("t/emission", b"on")
        assert bus.connected()
        await router.kill()
        assert await until(lambda: not bus.connected()) < 1.0
        started_s = time.monotonic()
        for _ in range(20):
            bus.put_latest("t/position", b"lost", urgent=True)
            bus.put_reliably("t/emission", b"lost too")
        assert time.monotonic() - started_s < 3.0
    finally:
        started_s = time.monotonic()
        await opened.__aexit__(None, None, None)
    assert time.monotonic() - started_s < 5.0


@pytest.mark.slow
async def test_a_router_that_comes_back_is_joined_again_and_the_last_values_with_it(router):
    async with open_bus(router.endpoint) as sender, open_bus(router.endpoint) as receiver:
        inbox = Inbox()
        receiver.subscribe("t/*", inbox.take)
        sender.put_reliably("t/emission", b"on")
        await router.kill()
        await until(lambda: not sender.connected() and not receiver.connected())
        await router.start()
        await until(lambda: sender.connected() and receiver.connected(), timeout_s=8.0)
        inbox.samples.clear()
        await inbox.until_ready(lambda: sender.put_latest("t/position", b"again"))
        assert await fetched(receiver, "t/emission", {"t/emission": b"on"})


@pytest.mark.slow
def test_a_process_that_dies_of_an_error_on_the_bus_does_not_hang_at_its_end(tmp_path):
    script = (
        "import asyncio\n"
        "from drivers.bus.session import BusEndpoint, open_bus\n"
        "from drivers.simulation.launcher import free_tcp_port\n"
        "async def main():\n"
        "    async with open_bus(BusEndpoint(f'tcp/127.0.0.1:{free_tcp_port()}', role='router')) as bus:\n"
        "        bus.subscribe('t/*', print)\n"
        "        bus.put_reliably('t/x', b'1')\n"
        "        raise SystemExit(7)\n"
        "asyncio.run(main())\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], env=os.environ, timeout=10, check=False)
    assert ended.returncode == 7


@pytest.mark.slow
async def test_a_router_that_cannot_listen_says_so_and_ends(router, group):
    await group.start("second", ["-m", "drivers.bus.router", router.endpoint.endpoint])
    async with asyncio.timeout(PATIENCE_S):
        assert await group.processes["second"].wait() == 2
    said = (group.log_dir / "second.log").read_text()
    assert f"the bus at {router.endpoint.endpoint} cannot be opened as router" in said


@pytest.mark.slow
async def test_a_router_ends_with_the_process_that_started_it(group, tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    script = (
        "import os, subprocess, sys\n"
        "router = [sys.executable, '-m', 'drivers.bus.router', sys.argv[1], '--parent-pid', str(os.getpid())]\n"
        "subprocess.Popen(router)\n"
        "sys.stdin.read()\n"
    )
    parent = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", script, endpoint), stdin=asyncio.subprocess.PIPE
    )
    try:
        await until(lambda: _answers(endpoint))
    finally:
        parent.stdin.close()
        assert await asyncio.wait_for(parent.wait(), PATIENCE_S) == 0
    await until(lambda: not _answers(endpoint), timeout_s=3.0)


def _answers(endpoint):
    host, port = endpoint.removeprefix("tcp/").split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


async def test_without_a_router_opening_is_an_error_at_once_that_names_the_endpoint():
    endpoint = BusEndpoint(f"tcp/127.0.0.1:{free_tcp_port()}")
    started_s = time.monotonic()
    with pytest.raises(BusError, match=f"the bus at {endpoint.endpoint} cannot be opened as client.*router running"):
        async with open_bus(endpoint):
            pass
    assert time.monotonic() - started_s < 3.0


@pytest.mark.parametrize("text", ["", "127.0.0.1:7447", "nonsense/127.0.0.1:7447", "tcp/127.0.0.1", "tcp/127.0.0.1:x"])
async def test_an_endpoint_that_is_none_is_a_bus_error(text):
    with pytest.raises(BusError, match="tcp/HOST:PORT"):
        async with open_bus(BusEndpoint(text)):
            pass


def test_a_session_opens_nothing_but_its_endpoint():
    client = BusEndpoint("tcp/127.0.0.1:7447").configuration()
    router = BusEndpoint("tcp/127.0.0.1:7447", role="router").configuration()
    for configuration in (client, router):
        assert configuration.get_json("scouting/multicast/enabled") == "false"
        assert configuration.get_json("scouting/gossip/enabled") == "false"
    assert client.get_json("listen/endpoints") == "[]"
    assert client.get_json("connect/endpoints") == '["tcp/127.0.0.1:7447"]'
    assert router.get_json("listen/endpoints") == '["tcp/127.0.0.1:7447"]'
    assert router.get_json("connect/endpoints") == "[]"
