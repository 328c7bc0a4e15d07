"""`keys init`: a file for everybody of a playbook, its owner's alone, with which the bus can be joined."""

import asyncio
import contextlib
import json
import os
import stat
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from drivers.bus.keys import SwarmKeys
from drivers.bus.security import with_keys
from drivers.bus.session import BusEndpoint, open_bus
from drivers.errors import BusError
from drivers.simulation.launcher import free_tcp_port, process_group
from gcs.commands import keys
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook
from gcs.run_bus import joined

PLAYBOOK = """\
playbook: 1
name: three
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters:
  L0: {at: [0, 0], beacon: true}
  L1: {at: [100, 0]}
receivers:
  U1: {start: [20, 30]}
"""
FILES = {"router.json5", "service.json5", "operator.json5", "uav.L1.json5", "uav.U1.json5"}


def run(tmp_path: Path, *arguments: str, playbook: str = PLAYBOOK) -> Result:
    path = tmp_path / "three.yaml"
    path.write_text(playbook)
    app = typer.Typer()
    app.add_typer(keys.app, name="keys")
    return CliRunner().invoke(app, ["keys", "init", str(path), "--out", str(tmp_path / "keys"), *arguments])


def test_everybody_of_the_playbook_gets_a_file_that_is_its_owner_s_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        result = run(tmp_path, "--router", "tls/10.0.0.1:7447")
    finally:
        os.umask(before)
    assert result.exit_code == 0, result.output
    folder = tmp_path / "keys"
    assert {path.name for path in folder.iterdir()} == FILES
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert all(name in result.output for name in FILES)
    assert "companion computer of U1" in result.output
    assert "BEGIN" not in result.output


async def test_with_the_files_the_operator_asks_and_a_uav_does_not(tmp_path: Path) -> None:
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    with_router = PLAYBOOK + f"bus: {{router: {endpoint}}}\n"
    assert run(tmp_path, playbook=with_router).exit_code == 0

    def of(party: str) -> BusEndpoint:
        role = "router" if party == "router" else "client"
        return with_keys(BusEndpoint(endpoint, role), tmp_path / "keys" / f"{party}.json5")

    control = SwarmKeys("three").control
    async with (
        open_bus(of("router")),
        open_bus(of("service")) as service,
        open_bus(of("operator")) as operator,
        open_bus(of("uav.U1")) as uav,
    ):
        service.serve(control, lambda _: b"done")
        answer = b""
        async with asyncio.timeout(5.0):
            while not answer:
                with contextlib.suppress(BusError):  # it becomes known a little later
                    answer = await operator.ask(control, b"hold")
        assert answer == b"done"
        with pytest.raises(BusError, match="is not answered"):
            await uav.ask(control, b"hold")


def test_a_site_gets_a_router_of_its_own_that_connects_to_the_other(tmp_path: Path) -> None:
    result = run(tmp_path, "--router", "tls/10.0.0.1:7447", "--site", "south=tls/10.1.0.1:7448")
    assert result.exit_code == 0, result.output
    folder = tmp_path / "keys"
    assert {path.name for path in folder.iterdir()} == FILES | {"router.south.json5"}
    assert "router of site south" in result.output
    written = json.loads((folder / "router.south.json5").read_text())
    assert written["listen"]["endpoints"] == ["tls/10.1.0.1:7448"]
    assert written["connect"]["endpoints"] == ["tls/10.0.0.1:7447"]
    assert "connect" not in json.loads((folder / "router.json5").read_text())


def test_keys_are_not_overwritten(tmp_path: Path) -> None:
    assert run(tmp_path, "--router", "tls/10.0.0.1:7447").exit_code == 0
    before = {path: path.read_bytes() for path in (tmp_path / "keys").iterdir()}
    again = run(tmp_path, "--router", "tls/10.0.0.1:7447").exception
    assert isinstance(again, ServiceError)
    assert "is there already: keys are not overwritten" in str(again)
    assert before == {path: path.read_bytes() for path in (tmp_path / "keys").iterdir()}


@pytest.mark.parametrize(
    ("arguments", "kind", "says"),
    [
        ([], ServiceError, "Give --router tls/HOST:PORT"),
        (["--router", "tcp/10.0.0.1:7447"], BusError, "write tls/HOST:PORT"),
        (["--router", "tls/10.0.0.1:7447", "--swarm", "a/b"], ServiceError, "no name of a swarm"),
        (["--router", "tls/10.0.0.1:7447", "--swarm", "*"], ServiceError, "no name of a swarm"),
        (["--router", "tls/10.0.0.1:7447", "--site", "tls/10.1.0.1:7447"], ServiceError, "--site takes NAME=tls/HOST"),
        (["--router", "tls/10.0.0.1:7447", "--site", "a/b=tls/10.1.0.1:7447"], ServiceError, "is no site"),
        (["--router", "tls/10.0.0.1:7447", "--site", "south=tcp/10.1.0.1:7447"], BusError, "write tls/HOST:PORT"),
        (["--router", "tls/10.0.0.1:7447", *["--site", "a=tls/10.1.0.1:7447"] * 2], ServiceError, "given twice"),
    ],
)
def test_what_cannot_be_used_is_said_and_nothing_is_written(
    tmp_path: Path, arguments: list[str], kind: type[Exception], says: str
) -> None:
    error = run(tmp_path, *arguments).exception
    assert isinstance(error, kind)
    assert says in str(error)
    assert not (tmp_path / "keys").exists()


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    error = run(tmp_path, "--router", "tls/10.0.0.1:7447", "--out", str(tmp_path / "file" / "keys")).exception
    assert isinstance(error, ServiceError)
    assert "cannot be written: Not a directory" in str(error)


@pytest.mark.parametrize("router", ["", "router: tcp/10.0.0.1:7447, "])
def test_a_playbook_s_bus_with_keys_has_a_router_that_can_be_closed(tmp_path: Path, router: str) -> None:
    path = tmp_path / "three.yaml"
    path.write_text(PLAYBOOK + f"bus: {{{router}keys: keys/service.json5}}\n")
    with pytest.raises(ServiceError, match="has its router at tls/HOST:PORT"):
        load_playbook(path)


@pytest.mark.slow
async def test_a_router_with_keys_is_joined_with_keys_alone(tmp_path: Path) -> None:
    endpoint = f"tls/127.0.0.1:{free_tcp_port()}"
    assert run(tmp_path, "--router", endpoint).exit_code == 0
    folder = tmp_path / "keys"
    async with process_group(tmp_path) as group:
        arguments = ["-m", "drivers.bus.router", endpoint, "--keys", str(folder / "router.json5")]
        await group.start("router", [*arguments, "--parent-pid", str(os.getpid())])
        async with joined(endpoint, str(folder / "service.json5")) as bus:
            assert bus.connected()
        with pytest.raises(BusError, match="cannot be opened"):
            async with open_bus(BusEndpoint(endpoint)):
                pass
