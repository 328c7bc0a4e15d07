"""`monitor` finds the run it is told of, and commands only with the token."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.bus.messages import ControlRequest, decode
from drivers.bus.run_messages import ProvenRequest, decode_run
from drivers.errors import BusError
from gcs.commands.monitor import monitor
from gcs.errors import ServiceError
from gcs.monitor.access import COMMAND_VARIABLE
from gcs.monitor.client import RunClient
from gcs.monitor.terminal_app import app
from gcs.recording.bus_address import BusAddress

SECRET = "correct horse battery staple"


class Screen:
    """Takes the place of the terminal, and keeps what it was to show."""

    def __init__(self) -> None:
        self.client: RunClient | None = None
        self.commands = False

    async def show(self, client: RunClient, *, commands: bool) -> None:
        self.client, self.commands = client, commands


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Screen:
    made = Screen()
    monkeypatch.setattr(app, "show", made.show)
    monkeypatch.delenv(COMMAND_VARIABLE, raising=False)
    return made


def run_folder(runs_dir: Path, name: str, address: BusAddress) -> Path:
    folder = runs_dir / name
    folder.mkdir(parents=True)
    (folder / "bus.json").write_text(f'{{"endpoint": "{address.endpoint}", "swarm": "{address.swarm}"}}')
    return folder


def test_without_anything_it_is_the_newest_run_and_the_next_one_when_it_begins(screen: Screen, tmp_path: Path) -> None:
    monitor(runs_dir=tmp_path)
    with pytest.raises(ServiceError, match="no run in"):
        screen.client.find()
    first, second = BusAddress("tcp/127.0.0.1:1", "first"), BusAddress("tcp/127.0.0.1:2", "second")
    run_folder(tmp_path, "1", first)
    assert screen.client.find() == first
    run_folder(tmp_path, "2", second)
    assert screen.client.find() == second


def test_a_run_or_a_bus_can_be_named(screen: Screen, tmp_path: Path) -> None:
    address = BusAddress("tcp/127.0.0.1:1", "first")
    folder = run_folder(tmp_path, "1", address)
    run_folder(tmp_path, "2", BusAddress("tcp/127.0.0.1:2", "second"))
    monitor(run=folder, runs_dir=tmp_path)
    assert screen.client.find() == address
    monitor(connect="tcp/10.0.0.5:7447", insecure=True, runs_dir=tmp_path)
    assert screen.client.find() == BusAddress("tcp/10.0.0.5:7447", "", insecure=True)
    monitor(connect="tcp/10.0.0.5:7447", insecure=True, swarm="paper-8", runs_dir=tmp_path)
    assert screen.client.find() == BusAddress("tcp/10.0.0.5:7447", "paper-8", insecure=True)
    with pytest.raises(BusError, match="--insecure"):
        monitor(connect="tcp/10.0.0.5:7447", runs_dir=tmp_path)


def test_a_swarm_that_is_no_name_is_refused(screen: Screen) -> None:
    with pytest.raises(ServiceError, match="no name of a swarm"):
        monitor(connect="tcp/10.0.0.5:7447", swarm="a/**")
    assert screen.client is None


def test_it_is_read_only_without_the_token(screen: Screen, tmp_path: Path) -> None:
    monitor(runs_dir=tmp_path)
    assert not screen.commands
    assert decode(screen.client.say("paper-8", ControlRequest("hold")), ControlRequest).verb == "hold"


def test_with_the_token_it_commands_and_proves_it(screen: Screen, tmp_path: Path) -> None:
    token_file = tmp_path / "token"
    token_file.write_text(SECRET)
    token_file.chmod(0o600)
    monitor(runs_dir=tmp_path, command_token_file=token_file)
    assert screen.commands
    payload = screen.client.say("paper-8", ControlRequest("hold"))
    assert decode_run(payload, ProvenRequest).verb == "hold"
    assert SECRET.encode() not in payload


def test_a_token_others_can_read_is_refused(screen: Screen, tmp_path: Path) -> None:
    token_file = tmp_path / "token"
    token_file.write_text(SECRET)
    token_file.chmod(0o644)
    with pytest.raises(ServiceError, match="chmod 600"):
        monitor(runs_dir=tmp_path, command_token_file=token_file)
