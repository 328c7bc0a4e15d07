"""A playbook says where its bus is, and that strangers can join only when that is meant."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import BusError
from gcs.cli import app
from gcs.playbook.loader import PlaybookError, load_playbook

PLAYBOOK = """\
playbook: 1
name: three
formation: {kind: circle, slots: 1, radius_m: 60}
transmitters: {L0: {at: [0, 0]}, L1: {at: [60, 0]}}
receivers: {U1: {start: [30, 50]}}
"""


def with_bus(folder: Path, bus: str) -> Path:
    path = folder / "three.yaml"
    path.write_text(PLAYBOOK + f"bus: {bus}\n")
    return path


@pytest.mark.parametrize("router", ["tcp/10.0.0.1:7447", "tcp/0.0.0.0:7447", "udp/224.0.0.224:7446", "tls/a.example:1"])
def test_a_router_that_strangers_reach_has_keys_or_is_meant_to_be_open(tmp_path: Path, router: str) -> None:
    with pytest.raises(PlaybookError) as caught:
        load_playbook(with_bus(tmp_path, f"{{router: '{router}'}}"))
    (problem,) = caught.value.problems
    assert (problem.line, problem.column) == (6, 7)
    assert "insecure: true" in problem.message
    assert "keys init" in problem.message
    assert load_playbook(with_bus(tmp_path, f"{{router: '{router}', insecure: true}}")).bus.router == router


@pytest.mark.parametrize("bus", ["{router: 'tcp/127.0.0.1:7447'}", "{router: 'tls/10.0.0.1:7447', keys: k}", "{}"])
def test_loopback_and_a_closed_bus_need_no_word(tmp_path: Path, bus: str) -> None:
    assert not load_playbook(with_bus(tmp_path, bus)).bus.insecure


@pytest.mark.parametrize(
    "arguments",
    [
        ["sensor", "replay", "--swarm", "three", "--uav", "U1"],
        ["control", "hold", "--swarm", "three"],
    ],
)
def test_a_command_joins_an_open_bus_only_when_told_so(arguments: list[str]) -> None:
    refused = CliRunner().invoke(app, [*arguments, "--connect", "tcp/10.0.0.1:7447"]).exception
    assert isinstance(refused, BusError)
    assert "--insecure" in str(refused)
