"""Playbooks that are broken, hostile or absurd: they load, or every problem is said with its place in the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from gcs.playbook.loader import PlaybookError, load_runs
from tests.fuzz.hostile import as_json, damaged, ends_well, examples, mutated

FOUR = Path("sitl_configs/four.yaml").read_text(encoding="utf-8")
WHOLE = """\
playbook: 1
name: whole
seed: 7
site: {latitude_deg: 47.2, longitude_deg: 8.5, altitude_m: 400, axis_azimuth_deg: 30}
formation: {kind: circle, slots: 2, radius_m: 60, scale: 1.1, rotation_deg: 5, mirrored: false}
transmitters: {L0: {at: [0, 0]}, L1: {at: [60, 0], beacon: true}}
receivers: {U1: {start: [30, 50]}, U2: {start: {radius_m: 70, angle_deg: 160}}}
fleet: {autopilot: ardupilot, signing: {key_variable: KEY}}
vehicle_types: {radio: {link: "udpin:127.0.0.1:14550", fallback: ["tcp:127.0.0.1:5760"]}}
vehicles:
  {L0: {type: radio, system_id: 1}, U1: {type: radio, system_id: 2}, U2: {link: "tcp:127.0.0.1:1", system_id: 3}}
planner: {method: joint, objective: length, min_separation_m: 5, fence: [[-200, -200], [200, -200], [0, 200]]}
flight: {altitude_m: 20, speed_mps: 4, lease_s: 0.5, give_up_s: 5}
sensor: {reference: true_north, sigma_deg: 0.2, faults: {outlier_share: 0.1, gaps: {every_s: 30, for_s: 1}}}
bus: {router: "tls/10.0.0.1:7447", keys: service.json5, insecure: false}
mavlink: {system_id: 255}
simulation: {wind_mps: 2}
stages: [preflight, {takeoff: {name: up}}, {relay: {expect: {placement_error_m: "< 1"}}}, {prompt: {text: ready?}}]
expect: {min_separation_m: "> 5", duration_s: 60 .. 90}
matrix: {sensor.sigma_deg: [0.1, 0.5], seed: [1, 2]}
"""
DOCUMENT = YAML(typ="safe").load(WHOLE)
FRAGMENTS = (
    "seed: !!omap [a: 1]",
    "seed: !!set {a, b}",
    "seed: !!binary aGVsbG8=",
    "seed: !!python/object/apply:os.system [ls]",
    "seed: &a [*a]",
    "seed: {<<: [1]}",
    "expect: !!omap [a: 1]",
    "<<: {seed: x, name: 5, planner: {method: 7}}",
    "seed: 0x" + "f" * 20_000,
    "seed: " + "9" * 5000,
    "seed: 1e999999",
    "seed: .nan",
    "expect: {? {a: b} : 4, null: 3, [1, 2]: 3, 2026-11-11: 2, ~: 1}",
    "expect: {a: &a {b: *a}}",
    "matrix: {null: [1], 3: [2], seed: [[[[]]]]}",
    "name: '\\ud800'\nexpect: {\"\\ud800\": 1}",
    "--- {}",
    "%TAG ! tag:x,2000:",
    "\x07",
    "a: [" + "[" * 400,
    "a: " + "{a: " * 400,
    "? " * 400,
    "- " * 400,
    "a: |" + "9" * 30,
    "*x",
    "a: &" + "x" * 2000 + " 1",
)


def looked_into(path: Path) -> None:
    """Load a playbook; when it is none, be told so in lines that name the file, or a file that it names."""
    with ends_well():
        try:
            load_runs(path)
        except PlaybookError as error:
            assert error.problems  # noqa: PT017 - some load
            for problem in error.problems:
                assert problem.message
                assert min(problem.line, problem.column) >= 1
                assert len(problem.message) < 20_000


def test_the_good_ones_are_good(tmp_path: Path) -> None:
    path = tmp_path / "good.yaml"
    for text in (FOUR, WHOLE):
        path.write_text(text)
        assert load_runs(path)


@examples(60)
@given(data=st.data())
def test_a_text_that_is_damaged(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "damaged.yaml"
    path.write_bytes(data.draw(damaged(data.draw(st.sampled_from((FOUR, WHOLE))).encode())))
    looked_into(path)


@examples(60)
@given(data=st.data())
def test_a_structure_with_anything_in_it(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "mutated.yaml"
    path.write_bytes(data.draw(mutated(DOCUMENT).map(as_json)))
    looked_into(path)


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=map(str, range(len(FRAGMENTS))))
def test_what_yaml_can_say_beyond_a_playbook(tmp_path: Path, fragment: str) -> None:
    path = tmp_path / "odd.yaml"
    for text in (f"{FOUR}\n{fragment}\n", fragment, f"{FOUR.replace('seed:', 'old_seed:')}\nplanner: {{{fragment}}}\n"):
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        looked_into(path)


def test_aliases_cannot_make_a_small_file_large(tmp_path: Path) -> None:
    path = tmp_path / "bomb.yaml"
    lists = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lists += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 20)]
    path.write_text(FOUR + "\n" + "\n".join(lists))
    with ends_well(5.0), pytest.raises(PlaybookError, match="more than 100000 values"):
        load_runs(path)


def test_a_file_without_an_end_is_not_read_to_it() -> None:
    with pytest.raises(PlaybookError, match="too large"):
        load_runs(Path("/dev/zero"))


@examples(25)
@given(data=st.data())
def test_a_playbook_that_loads_is_planned_or_it_is_said_why_not(tmp_path: Path, data: st.DataObject) -> None:
    small: dict[str, Any] = {name: DOCUMENT[name] for name in ("playbook", "name", "formation", "transmitters")}
    small |= {name: DOCUMENT[name] for name in ("receivers", "planner", "flight", "sensor")}
    path = tmp_path / "planned.yaml"
    path.write_bytes(as_json(data.draw(mutated(small))))
    with ends_well(60.0):
        for run in load_runs(path):
            if len(run.playbook.receivers) <= 3:
                run.playbook.plan()
