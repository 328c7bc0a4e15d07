"""Hundreds of malformed playbooks, made from a good one: each says what is wrong on the line where it is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.playbook.loader import PlaybookError, load_playbook, load_runs

GOOD = """\
playbook: 1
name: whole
slow: false
target: embedded
seed: 7
site:
  latitude_deg: 47.2
  longitude_deg: 8.5
  altitude_m: 400
  axis_azimuth_deg: 30
formation:
  kind: circle
  slots: 3
  radius_m: 60
  scale: 1.1
  rotation_deg: 5
  mirrored: false
transmitters:
  L0:
    at: [0, 0]
  L1:
    at: [60, 0]
    beacon: true
receivers:
  U1:
    start: [30, 50]
  U2:
    start: [-70, 20]
  U3:
    start: [15, -80]
fleet:
  autopilot: ardupilot
vehicle_types:
  radio:
    link: "udpin:127.0.0.1:14550"
planner:
  method: joint
  objective: length
  min_separation_m: 5
  samples: 10
  start_sigma_m: 1
flight:
  altitude_m: 20
  speed_mps: 4
  placement_tolerance_m: 3
  lease_s: 0.5
  give_up_s: 5
sensor:
  reference: true_north
  sigma_deg: 0.2
  rate_hz: 10
  latency_s: 0.1
  drop_out: 0
  faults:
    outlier_share: 0.1
    latency_jitter_s: 0.1
    gaps:
      every_s: 30
      for_s: 1
mavlink:
  system_id: 255
simulation:
  wind_mps: 2
  gusts_mps: 1
stages:
  - connect:
      retries: 1
      timeout_s: 60
  - preflight
  - takeoff:
      name: up
      on_failure: land
  - inject:
      fault: freeze
      vehicle: U2
      for_s: 2
      at:
        receiver: U2
        state: LEG_1
        after_s: 1
  - relay:
      timeout_s: 300
      expect:
        placement_error_m: "< 1"
        receivers_placed: 3
  - measure:
      for_s: 5
      every_s: 0.5
  - prompt:
      text: ready to land?
  - land
expect:
  min_separation_m: "> 5"
matrix:
  sensor.sigma_deg: [0.1, 0.5]
"""
LINES = GOOD.splitlines()
KEYED = {
    number: found.groups()
    for number, line in enumerate(LINES)
    if (found := re.fullmatch(r"( *(?:- )?)([a-z_.0-9]+):( ?)(.*)", line)) is not None and "radio:" not in line
}
"""The lines with a key of the schema: how far it is indented, the key, and its value where it is on the same line."""


def malformed() -> Iterator[tuple[int, str]]:
    """Yield playbooks with one line made wrong, and which one (counted from 1)."""

    def with_line(number: int, *instead: str) -> str:
        return "\n".join([*LINES[:number], *instead, *LINES[number + 1 :]]) + "\n"

    for number, (indent, key, space, value) in KEYED.items():
        misspelt = number if key == "kind" else number + 1  # without a kind nobody knows what a formation may say
        yield misspelt, with_line(number, f"{indent}{key}x:{space}{value}")
        yield misspelt, with_line(number, f"{indent}{key.upper()}:{space}{value}")
        if value:
            for wrong in ("[[7]]", "{a: {b: []}}", "2026-11-23"):
                yield number + 1, with_line(number, f"{indent}{key}: {wrong}")
        if value and "-" not in indent:
            yield number + 2, with_line(number, LINES[number], LINES[number])


CASES = list(malformed())


def test_a_good_one_loads_and_hundreds_are_made_from_it(tmp_path: Path) -> None:
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    assert len(load_runs(path)) == 2
    assert len(CASES) >= 200
    assert len({text for _, text in CASES}) == len(CASES)


@pytest.mark.parametrize("part", range(8))
def test_each_says_what_is_wrong_where_it_is_wrong(tmp_path: Path, part: int) -> None:
    path = tmp_path / "malformed.yaml"
    for line, text in CASES[part::8]:
        path.write_text(text)
        with pytest.raises(PlaybookError) as caught:
            load_playbook(path)
        found = [problem.line for problem in caught.value.problems]
        assert line in found, (text.splitlines()[line - 1], list(map(str, caught.value.problems)))
        assert all(problem.message for problem in caught.value.problems)


def test_half_a_character_and_a_number_beyond_all_bounds_are_said(tmp_path: Path) -> None:
    path = tmp_path / "malformed.yaml"
    path.write_text(GOOD.replace("name: whole", 'name: "\\ud800"'))
    with pytest.raises(PlaybookError, match=r"'\\ud800' is not text"):
        load_playbook(path)
    for far in ("1.0e+154", 10**400, ".nan", 100_001):
        path.write_text(GOOD.replace("at: [60, 0]", f"at: [{far}, 0]"))
        with pytest.raises(PlaybookError, match=r"L1\.at: a point is \[x, y\] .* within 100 km") as caught:
            load_playbook(path)
        assert [problem.line for problem in caught.value.problems] == [GOOD.splitlines().index("    at: [60, 0]") + 1]
