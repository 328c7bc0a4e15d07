"""Signed links at a node: with the key that the playbook names, looked up where the node is."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import DriverError
from drivers.mavlink.codec import Codec, FrameSplitter
from drivers.mavlink.signing import open_signing
from drivers.mavlink.signing_key import SigningKey
from drivers.tasks import open_background
from gcs.nodes.link_node import NoLogs
from gcs.nodes.messages import Post
from gcs.nodes.tenure import Tenure
from gcs.nodes.wires import Wires

KEY = bytes(range(32))
VARIABLE = "A_NODE_S_SIGNING_KEY"


@contextlib.asynccontextmanager
async def wires(folder: Path):
    clock = SystemClock()
    async with open_signing(clock, folder / "signing") as signing, open_background() as start:

        async def opened():
            return signing

        yield Wires(Tenure(life=1), clock, NoLogs().of, opened, start)


def post(link: str, **key: str) -> Post:
    return Post(1, 3, link, [0], altitude_m=4.0, speed_mps=4.0, lease_s=0.5, **key)


@pytest.mark.parametrize("kind", ["key_variable", "key_file"])
async def test_every_frame_is_signed_with_the_key_that_is_here(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, KEY.hex())
    file = tmp_path / "key"
    file.touch(mode=0o600)
    file.write_text(KEY.hex())
    named = {"key_variable": VARIABLE} if kind == "key_variable" else {"key_file": str(file)}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(0.0)
        async with wires(tmp_path) as opened, open_signing(SystemClock(), tmp_path / "vehicle") as theirs:
            await opened.open("U1", post(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}", **named), 255)
            async with asyncio.timeout(20.0):
                data = await asyncio.get_running_loop().sock_recv(vehicle, 2048)
            await opened.close("U1")
            (frame,) = FrameSplitter().datagram(data)
            assert theirs.link(SigningKey(KEY), "a").accepts(frame)
            assert not theirs.link(SigningKey(KEY[::-1]), "b").accepts(frame)
            message = Codec().decode(frame)
            assert message is not None
            assert message.get_type() == "HEARTBEAT"


@pytest.mark.parametrize("named", [{"key_variable": VARIABLE}, {"key_file": "/nowhere/key"}])
async def test_without_the_key_a_link_is_not_opened_and_nothing_is_sent_unsigned(
    named: dict[str, str], tmp_path: Path
) -> None:
    assert VARIABLE not in os.environ
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(0.0)
        async with wires(tmp_path) as opened:
            with pytest.raises(DriverError, match=next(iter(named.values()))):
                await opened.open("U1", post(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}", **named), 255)
        with pytest.raises(BlockingIOError):
            vehicle.recv(2048)
