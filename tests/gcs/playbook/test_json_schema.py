"""The JSON Schema of a playbook agrees with the loader on what may be written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer
from ruamel.yaml import YAML
from typer.testing import CliRunner

from gcs.commands.schema import schema
from gcs.playbook.json_schema import DIALECT, playbook_schema
from gcs.playbook.loader import PlaybookError, load_playbook
from tests.gcs.playbook.test_loader import GOOD, READY

CHECK = jsonschema.Draft202012Validator(playbook_schema())


def parsed(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def test_it_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(playbook_schema())
    assert playbook_schema()["$schema"] == DIALECT


@pytest.mark.parametrize("path", READY, ids=lambda path: path.stem)
def test_every_ready_playbook_validates(path: Path) -> None:
    CHECK.validate(parsed(path.read_text()))


@pytest.mark.parametrize(
    ("found", "instead"),
    [
        ("", ""),
        ("[60, 0]", "{radius_m: 60, angle_deg: 0.5}"),
        ("{kind: circle, slots: 3, radius_m: 60}", "{kind: custom, slots: {A: [9, 40], B: [30, 50], C: [5, -40]}}"),
        ("{kind: circle, slots: 3, radius_m: 60}", "{kind: grid, slots: 3, spacing_m: 20, columns: null}"),
        ("name: three", "name: three\nplanner: {fence: [[-100, -100], [100, -100], [100, 100], [-100, 100]]}"),
        ("name: three", "name: three\nsite: {latitude_deg: 47, longitude_deg: 8, altitude_m: 400}"),
        ("name: three", "name: three\nplanner: {method: paper}"),
        ("name: three", "name: three\nsensor: {faults: {bias_deg: 3, clock_offset_s: {U1: 2.5, '*': 1}}}"),
        ("name: three", "name: three\nsensor: {faults: {outlier_jumps_deg: [45, [9, 12]]}}"),
        (
            "name: three",
            "name: three\nstages: [preflight, takeoff, {relay: {timeout_s: 9, on_failure: land}}, {land: null}]",
        ),
        ("name: three", "name: three\nstages: [{emission: {on: [L0]}}, {wait: {for_s: 1}}]\nexpect: {outcome: formed}"),
        ("name: three", "name: three\nmatrix: {sensor.sigma_deg: [0.1, 0.5], seed: [1, 2]}\ntarget: px4\nslow: true"),
        ("name: three", "name: three\nfleet: {autopilot: px4}\nvehicle_types: {a: {link: 'udpin:127.0.0.1:9'}}"),
    ],
)
def test_what_the_loader_takes_validates(tmp_path: Path, found: str, instead: str) -> None:
    text = GOOD.replace(found, instead)
    path = tmp_path / "good.yaml"
    path.write_text(text)
    load_playbook(path)
    CHECK.validate(parsed(text))


@pytest.mark.parametrize(
    ("found", "instead"),
    [
        ("name: three", "name: three\nnmae: x"),
        ("name: three", "name: three\nplanner: {method: magic}"),
        ("name: three", "name: three\nvehicles: {U1: {link: 'udp:14550', system_id: 1}}"),
        ("name: three", "name: a/b"),
        ("playbook: 1", "playbook: 2"),
        ("playbook: 1\n", ""),
        ("slots: 3", "slots: 0"),
        ("slots: 3", "slots: three"),
        ("radius_m: 60", "radius: 60"),
        ("kind: circle", "kind: ring"),
        ("[60, 0]", "[60]"),
        ("[60, 0]", "[60, true]"),
        ("[60, 0]", "[60, 0, 0]"),
        ("angle_deg: 70", "angle: 70"),
        ("angle_deg: 70", "angle_deg: 70, x: 1"),
        ("L0: {at: [0, 0]}", "L0: {at: [0, 0], becon: true}"),
        ("U1: {", "U/1: {"),
        ("U1: {", "'': {"),
        ("U1: {", "U" + 64 * "1" + ": {"),
        ("name: three", "name: three\nflight: {speed_mps: 50}"),
        ("name: three", "name: three\nbus: {router: localhost}"),
        ("name: three", "name: three\nvehicles: {U1: {link: 'udpin:127.0.0.1:14550', system_id: 0}}"),
        ("name: three", "name: three\nplanner: {min_separation_m: 0}"),
        ("name: three", "name: three\nsensor: {faults: {bias_deg: x}}"),
        ("name: three", "name: three\nsensor: {faults: {outlier_jumps_deg: [x]}}"),
        ("name: three", "name: three\nstages: []"),
        ("name: three", "name: three\nstages: [takeof]"),
        ("name: three", "name: three\nstages: [hold]"),
        ("name: three", "name: three\nstages: [{}]"),
        ("name: three", "name: three\nstages: [{wait: {for_s: 1}, land: {}}]"),
        ("name: three", "name: three\nstages: [{wait: {for_s: 0}}]"),
        ("name: three", "name: three\nstages: [{wait: {for_s: 1, on_failure: panic}}]"),
        ("name: three", "name: three\nstages: [{wait: {for_s: 1, expect: {outcom: formed}}}]"),
        ("name: three", "name: three\nmatrix: {seed: 3}"),
        ("name: three", "name: three\nmatrix: {seed: []}"),
        ("name: three", "name: three\ntarget: moon"),
        ("name: three", "name: three\nfleet: {autopilot: betaflight}"),
    ],
)
def test_what_the_loader_refuses_does_not_validate(tmp_path: Path, found: str, instead: str) -> None:
    text = GOOD.replace(found, instead)
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(PlaybookError):
        load_playbook(path)
    assert not CHECK.is_valid(parsed(text))


def test_the_command_prints_or_writes_it_and_says_how_an_editor_finds_it(tmp_path: Path) -> None:
    app, out = typer.Typer(), tmp_path / "playbook.schema.json"
    app.command()(schema)
    assert json.loads(CliRunner().invoke(app, []).output) == playbook_schema()
    assert CliRunner().invoke(app, ["--out", str(out)]).exit_code == 0
    assert json.loads(out.read_text()) == playbook_schema()
    assert "yaml-language-server: $schema=playbook.schema.json" in CliRunner().invoke(app, ["--help"]).output


def test_a_resolved_playbook_can_be_read_back() -> None:
    playbook = load_playbook(Path("sitl_configs/paper_8.yaml"))
    resolved = json.loads(json.dumps(playbook.model_dump(mode="json")))
    assert resolved["transmitters"]["L1"]["at"] == [100.0, 0.0]
    assert type(playbook).model_validate(resolved) == playbook
    CHECK.validate(resolved)
