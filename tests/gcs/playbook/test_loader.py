"""Playbooks: the good load, the bad say everything that is wrong with file, line, column and what is allowed."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs.playbook.loader import PlaybookError, PlaybookProblem, load_playbook
from gcs.playbook.schema import Playbook

GOOD = """\
playbook: 1
name: three
formation: {kind: circle, slots: 3, radius_m: 60}
transmitters:
  L0: {at: [0, 0]}
  L1: {at: [60, 0]}
receivers:
  U1: {start: {radius_m: 40, angle_deg: 70}}
  U2: {start: [-70, 20]}
  U3: {start: [15, -80]}
"""

READY = sorted(Path("sitl_configs").glob("*.yaml"))


@pytest.fixture
def load(tmp_path: Path):
    def loader(text: str) -> Playbook:
        path = tmp_path / "test.yaml"
        path.write_text(text, encoding="utf-8")
        return load_playbook(path)

    return loader


def problems(load, text: str) -> list[str]:
    with pytest.raises(PlaybookError) as caught:
        load(text)
    return [f"{p.line}:{p.column}: {p.message}" for p in caught.value.problems]


def test_a_small_playbook_loads_with_every_default(load) -> None:
    playbook = load(GOOD)
    assert playbook.uavs["U1"] == pytest.approx(cmath.rect(40, math.radians(70)))
    assert playbook.uavs["U2"] == -70 + 20j
    assert list(playbook.uavs) == ["L0", "L1", "U1", "U2", "U3"]
    assert playbook.problem().slots.keys() == {"O1", "O2", "O3"}
    assert playbook.problem(0.0).min_separation_m == 0.0
    assert playbook.flight.speed_mps == playbook.problem().speed_mps == 5.0


@pytest.mark.parametrize("path", READY, ids=lambda path: path.stem)
def test_every_ready_playbook_loads(path: Path) -> None:
    assert load_playbook(path).receivers


def test_a_custom_formation_with_a_beacon(load) -> None:
    text = GOOD.replace(
        "{kind: circle, slots: 3, radius_m: 60}", "{kind: custom, slots: {A: [9, 40], B: [30, 50], C: [5, -40]}}"
    )
    playbook = load(text.replace("L1: {at: [60, 0]}", "L1: {at: [60, 0], beacon: true}"))
    assert list(playbook.problem().slots) == ["A", "B", "C"]
    assert playbook.beacons == {"L1": 60 + 0j}
    assert "L1" not in playbook.uavs


@pytest.mark.parametrize(
    ("found", "instead", "expected"),
    [
        ("name: three", "name: three\nnmae: x", "3:1: nmae: unknown key; did you mean 'name'?"),
        ("slots: 3", "slots: 0", "3:27: formation.slots: Input should be greater than or equal to 1, found 0"),
        ("slots: 3", "slots: three", "3:27: formation.slots: Input should be a valid integer, found 'three'"),
        ("radius_m: 60", "radius: 60", "3:37: formation.radius: unknown key; did you mean 'radius_m'? (allowed"),
        ("radius_m: 60", "radius: 60", "3:1: formation.radius_m: is missing"),
        ("kind: circle", "kind: ring", "3:13: formation.kind: is no formation (allowed are circle, polygon"),
        ("kind: circle, ", "", "3:1: formation.kind: is no formation"),
        ("kind: circle", "kind: cirlce", "3:13: formation.kind: is no formation; did you mean 'circle'?"),
        ("name: three", "name: three\nplanner: {method: [joint]}", "3:11: planner.method: a planning method is one"),
        ("[60, 0]", "[60]", "6:8: transmitters.L1.at: a point is [x, y] in metres"),
        ("[60, 0]", "[60, .nan]", "6:8: transmitters.L1.at: a point is [x, y] in metres"),
        ("[60, 0]", "[60, true]", "6:8: transmitters.L1.at: a point is [x, y] in metres"),
        ("angle_deg: 70", "angle: 70", "8:8: receivers.U1.start: a point is [x, y] in metres"),
        ("playbook: 1", "playbook: 2", "1:1: playbook: Input should be 1, found 2"),
        ("playbook: 1\n", "", "1:1: playbook: is missing"),
        ("name: three", "name: a/b", "2:1: name: String should match pattern"),
        ("L0: {at: [0, 0]}", "L0: {at: [0, 0], becon: true}", "5:20: transmitters.L0.becon: unknown key; did you"),
    ],
)  # fmt: skip
def test_each_problem_with_its_place_and_what_is_allowed(load, found: str, instead: str, expected: str) -> None:
    assert any(problem.startswith(expected) for problem in problems(load, GOOD.replace(found, instead)))


def test_a_wrong_kind_is_said_where_it_stands_in_a_block(load) -> None:
    block = "formation:\n  slots: 3\n  kind: ring\n  radius_m: 60"
    text = GOOD.replace("formation: {kind: circle, slots: 3, radius_m: 60}", block)
    [problem] = problems(load, text)
    assert problem.startswith("5:3: formation.kind: is no formation (allowed are circle")


def test_everything_wrong_is_said_at_once(load) -> None:
    text = (
        GOOD.replace("slots: 3", "slots: 0").replace("[60, 0]", "[60]")
        + "flight: {speed: 4}\nsensor: {sigma_deg: -1}\n"
    )
    assert len(problems(load, text)) == 4


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "1:1: is not a mapping"),
        ("- a\n- b\n", "1:1: is not a mapping"),
        ("name: [1, 2\n", "is not YAML"),
        ("a: 1\na: 2\n", "is not YAML"),
        ("\x00", "cannot be read"),
        ("a: &a [*a]\n", ""),
    ],
)
def test_what_is_no_playbook_at_all(load, text: str, expected: str) -> None:
    assert any(expected in problem for problem in problems(load, text))


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(PlaybookError, match="cannot be read"):
            load_playbook(path)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("vehicles: {U1: {link: 'udpin:127.0.0.1:14550', system_id: 1}}\n", "L0, L1, U2, U3 have no link"),
        ("vehicles: {U1: {link: 'udp:14550', system_id: 1}}\n", "is not SCHEME:HOST:PORT"),
        ("vehicles: {U1: {link: 'tcp:localhost:99999', system_id: 1}}\n", "is not SCHEME:HOST:PORT"),
        ("vehicles: {U1: {link: 'tcp:localhost:5760', system_id: 0}}\n", "greater than or equal to 1"),
        ("planner: {method: magic}\n", "a planning method is one of paper"),
        ("planner: {min_separation_m: 0}\n", "greater than 0"),
        ("bus: {router: localhost}\n", "should match pattern"),
        ("flight: {speed_mps: 50}\n", "less than or equal to 10"),
    ],
)
def test_sections_say_what_they_allow(load, more: str, expected: str) -> None:
    assert any(expected in problem for problem in problems(load, GOOD + more))


def test_a_vehicle_nobody_knows(load) -> None:
    links = "".join(
        f"  {n}: {{link: 'tcp:localhost:57{k}0', system_id: {k + 1}}}\n"
        for k, n in enumerate(["L0", "L1", "U1", "U2", "U3", "X"])
    )
    assert any("X are neither" in problem for problem in problems(load, GOOD + "vehicles:\n" + links))


def test_two_uavs_in_one_place_are_refused(load) -> None:
    assert any("U2 and U3 lie at the same place" in p for p in problems(load, GOOD.replace("[15, -80]", "[-70, 20]")))


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_playbooks_never_cause_a_traceback(load, data: st.DataObject) -> None:
    lines = GOOD.splitlines()
    row = data.draw(st.integers(0, len(lines) - 1))
    start = data.draw(st.integers(0, len(lines[row])))
    lines[row] = (
        lines[row][:start]
        + data.draw(st.text(st.characters(codec="utf-8"), max_size=6))
        + lines[row][start + data.draw(st.integers(0, 5)) :]
    )
    found: tuple[PlaybookProblem, ...] = ()
    try:
        load("\n".join(lines))
    except PlaybookError as error:
        found = error.problems
    assert all(1 <= problem.line <= len(lines) + 2 for problem in found)
