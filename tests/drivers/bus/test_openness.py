"""A bus that strangers can join is opened only by who says that it is meant."""

import subprocess
import sys

import pytest

from drivers.bus.openness import is_loopback, openness
from drivers.bus.session import BusEndpoint, open_bus, require_closed
from drivers.errors import BusError


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:7447", "tcp/localhost:7447", "tls/127.8.8.8:1", "udp/[::1]:7447", "quic/localhost:1"]
)
def test_loopback_is_this_machine_alone(endpoint):
    assert openness(endpoint) is None
    require_closed(BusEndpoint(endpoint))


OPEN = [
    "tcp/10.0.0.1:7447",
    "tcp/0.0.0.0:7447",
    "tcp/[::]:7447",
    "udp/224.0.0.224:7446",
    "tls/10.0.0.1:7447",
    "tcp/ground.example:7447",
    "tcp/127.0.0.1.example:7447",
    "tcp/localhost.:7447",
]
NONE = [
    "",
    "10.0.0.1:7447",
    "tcp/10.0.0.1",
    "tcp/127.0.0.1:7447?rel=1",
    "tcp/127.0.0.1:7447#iface=eth0",
    "tcp/127.0.0.1:7447,tcp/10.0.0.1:7447",
    "tcp/[::1]:7447/",
    "unixsock-stream/tmp",
]


@pytest.mark.parametrize("endpoint", OPEN)
async def test_what_strangers_reach_is_refused_with_both_ways_out(endpoint):
    for role in ("client", "router"):
        with pytest.raises(BusError, match=r"can join it and command the swarm.*keys init.*--insecure"):
            async with open_bus(BusEndpoint(endpoint, role)):
                pass
    require_closed(BusEndpoint(endpoint, insecure=True))


@pytest.mark.parametrize("endpoint", NONE)
def test_what_is_not_known_to_be_loopback_is_taken_for_none(endpoint):
    with pytest.raises(BusError, match="write it as tcp/HOST:PORT"):
        require_closed(BusEndpoint(endpoint))


@pytest.mark.parametrize("host", ["", "localhost ", "0x7f.1", "127.1", "::ffff:10.0.0.1", "0.0.0.0", "::"])
def test_a_host_that_only_looks_like_loopback_is_none(host):
    assert not is_loopback(host)


@pytest.mark.slow
def test_a_router_listens_to_strangers_only_when_told_so():
    command = [sys.executable, "-m", "drivers.bus.router", "tcp/0.0.0.0:0"]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert refused.returncode == 2
    assert "--insecure" in refused.stderr
    assert "Traceback" not in refused.stderr
