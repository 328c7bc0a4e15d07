"""What the figure of a plan contains; never its pixels."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from gcs.errors import ServiceError
from gcs.paper.printed import PRINTED
from gcs.paper.tables import recompute
from gcs.reports.figure import draw_plan
from planner.plan import Leg, RelayPlan, Route

TRANSMITTERS = {"L0": 0j, "L1": 100 + 0j}


@pytest.fixture(scope="module")
def paper():
    return recompute(PRINTED)


def _plan(*routes: Route) -> RelayPlan:
    return RelayPlan("paper", routes, straight_line_bound_m=1.0, makespan_s=1.0, emission_transmitter_s=1.0)


def _route(name: str, slot: str, *places: complex, guide: str = "L0") -> Route:
    legs = tuple(Leg(guide, "away", ("L0", "L1"), 1.0, begin, end) for begin, end in pairwise(places))
    return Route(name, slot, 1, 1, "I", places[0], places[-1], legs)


def _ids(path: Path) -> list[str]:
    return [element.attrib["id"] for element in ET.parse(path).iter() if "id" in element.attrib]


def _numbers(path: Path, gid: str) -> list[complex]:
    """The corner points of the one path under a group."""
    group = next(element for element in ET.parse(path).iter() if element.attrib.get("id") == gid)
    data = next(element.attrib["d"] for element in group.iter() if element.tag.endswith("}path"))
    values = [float(word) for word in data.split() if word not in "MLz"]
    return [complex(x, -y) for x, y in zip(values[::2], values[1::2], strict=True)]


@pytest.mark.parametrize("table", ["table_3", "table_4"])
def test_every_element_of_the_plan_is_drawn_once(paper, table, tmp_path):
    plan, path = getattr(paper, table).plan, tmp_path / "plan.svg"
    draw_plan(plan, TRANSMITTERS, path, title="the paper's")
    ids = _ids(path)
    expected = ["title", "legend", *(f"transmitter-{name}" for name in TRANSMITTERS)]
    for route in plan.routes:
        name = route.receiver
        expected += [f"slot-{route.slot}", f"start-{name}", f"turning-1-{name}"]
        expected += [f"{what}-{leg}-{name}" for what in ("leg", "arrow", "bearing") for leg in (1, 2)]
    expected += [f"label-{gid}" for gid in expected if gid.startswith(("slot", "start", "transmitter"))]
    assert {gid: ids.count(gid) for gid in expected} == dict.fromkeys(expected, 1)
    assert not any(gid.startswith("track-") for gid in ids)


def test_title_and_legend_say_what_is_shown(paper, tmp_path):
    path = tmp_path / "plan.svg"
    draw_plan(paper.flyable, TRANSMITTERS, path, tracks={"U1": [0j, 1j]}, title="Twenty")
    text = path.read_text()
    assert "<!-- Twenty: total length 951.32 m -->" in text
    for entry in (
        "leg 1",
        "leg 2",
        "transmitter",
        "slot",
        "start, its wave in it",
        "turning point",
        "bearing to the guide",
    ):
        assert f"<!-- {entry} -->" in text
    assert "<!-- flown track -->" in text
    assert "<!-- trim leg -->" not in text


def test_a_figure_without_a_title_still_says_the_total(paper, tmp_path):
    draw_plan(paper.table_3.plan, TRANSMITTERS, tmp_path / "plan.svg")
    assert "<!-- Total length 491.59 m -->" in (tmp_path / "plan.svg").read_text()


def test_one_scale_for_both_axes_and_y_upwards(tmp_path):
    path = tmp_path / "plan.svg"
    draw_plan(_plan(_route("U1", "O1", 0j, 40 + 0j, 40 + 30j)), TRANSMITTERS, path)
    first, second = _numbers(path, "leg-1-U1"), _numbers(path, "leg-2-U1")
    along, upwards = first[-1] - first[0], second[-1] - second[0]
    assert along.real > 0
    assert abs(along.imag) < 1e-6
    assert upwards == pytest.approx(along * 0.75j, abs=1e-3)


def test_a_bearing_runs_from_the_end_of_a_leg_to_the_slot_of_the_guiding_receiver(tmp_path):
    path = tmp_path / "plan.svg"
    guide = _route("U1", "O1", 10 + 10j, 50 + 50j)
    draw_plan(_plan(guide, _route("U2", "O2", 80j, 20 + 60j, guide="U1")), TRANSMITTERS, path)
    bearing, first, second = (_numbers(path, gid) for gid in ("bearing-1-U2", "leg-1-U1", "leg-1-U2"))
    assert bearing == pytest.approx([second[-1], first[-1]], abs=1e-3)


def test_legs_differ_in_colour_and_in_dashes(paper, tmp_path):
    path = tmp_path / "plan.svg"
    draw_plan(paper.table_3.plan, TRANSMITTERS, path)
    groups = {element.attrib.get("id"): element for element in ET.parse(path).iter()}
    first, second = (next(iter(groups[f"leg-{k}-U1"])).attrib["style"] for k in (1, 2))
    assert "#0072b2" in first
    assert "dasharray" not in first
    assert "#d55e00" in second
    assert "dasharray" in second


def test_flown_tracks_are_drawn_over_the_legs(paper, tmp_path):
    path = tmp_path / "plan.svg"
    tracks = {"U2": [45 + 46j, 50 + 51j, 68 + 69j], "U3": []}
    draw_plan(paper.table_3.plan, TRANSMITTERS, path, tracks)
    ids = _ids(path)
    assert "track-U3" not in ids
    assert ids.index("track-U2") > max(ids.index(gid) for gid in ids if gid.startswith("leg-"))
    assert len(_numbers(path, "track-U2")) == 3


def test_a_trim_leg_has_its_own_style_and_a_leg_without_length_none(tmp_path):
    path = tmp_path / "plan.svg"
    draw_plan(_plan(_route("U1", "O1", 20j, 40j, 40j, 41j), _route("U2", "O2", 9j, 9j, 5j)), TRANSMITTERS, path)
    ids = _ids(path)
    assert "leg-3-U1" in ids
    assert "<!-- trim leg -->" in path.read_text()
    assert not {"leg-2-U1", "arrow-2-U1", "bearing-2-U1", "leg-1-U2"} & set(ids)


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")])
def test_the_suffix_chooses_the_format(paper, tmp_path, suffix, magic):
    path = tmp_path / f"plan{suffix}"
    draw_plan(paper.table_3.plan, TRANSMITTERS, path)
    assert path.read_bytes().startswith(magic)


@pytest.mark.parametrize("name", ["plan.gif", "plan"])
def test_another_suffix_is_refused_with_the_ones_there_are(paper, tmp_path, name):
    with pytest.raises(ServiceError, match=r"must be one of \.svg, \.png, \.pdf"):
        draw_plan(paper.table_3.plan, TRANSMITTERS, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_path_that_cannot_be_written_is_named_with_the_reason(paper, tmp_path):
    path = tmp_path / "missing" / "plan.svg"
    with pytest.raises(ServiceError, match=r"plan\.svg: the figure cannot be written: No such file"):
        draw_plan(paper.table_3.plan, TRANSMITTERS, path)


def test_a_guide_nobody_knows_the_place_of_is_named(tmp_path):
    with pytest.raises(ServiceError, match="leg 1 of U1 is guided by B7"):
        draw_plan(_plan(_route("U1", "O1", 1j, 2j, guide="B7")), TRANSMITTERS, tmp_path / "plan.svg")


def test_names_and_titles_are_text_not_markup(tmp_path):
    path = tmp_path / "plan.svg"
    draw_plan(_plan(_route("$a_b$ <U&1>", "O$", 1j, 2j)), TRANSMITTERS, path, title="$x^$")
    assert "label-start-$a_b$ <U&1>" in _ids(path)


@pytest.mark.parametrize("turn", [1, 1j])
def test_a_long_thin_formation_keeps_its_scale(tmp_path, turn):
    path = tmp_path / "plan.svg"
    draw_plan(_plan(_route("U1", "O1", 0j, 3000 * turn, (3000 + 30j) * turn)), TRANSMITTERS, path)
    first, second = _numbers(path, "leg-1-U1"), _numbers(path, "leg-2-U1")
    assert second[-1] - second[0] == pytest.approx((first[-1] - first[0]) * 0.01j, abs=1e-3)


@pytest.mark.parametrize("chain", ["printed", "flyable"])
def test_no_label_covers_another_or_a_mark(paper, tmp_path, chain):
    path = tmp_path / "plan.svg"
    plan = paper.flyable if chain == "flyable" else paper.table_4.plan
    draw_plan(plan, TRANSMITTERS, path)
    groups = {element.attrib["id"]: element for element in ET.parse(path).iter() if "id" in element.attrib}
    boxes = {gid: _box(groups[gid]) for gid in groups if gid.startswith("label-")}
    marks = [_mark(groups[gid]) for gid in groups if gid.startswith(("slot-", "start-", "transmitter-", "turning-"))]
    assert (len(boxes), len(marks)) == (42, 62)
    for (one, (low, high)), (other, (left, right)) in combinations(boxes.items(), 2):
        apart = (left.real > high.real, right.real < low.real, left.imag > high.imag, right.imag < low.imag)
        assert any(apart), f"{one} over {other}"
    for gid, (low, high) in boxes.items():
        for mark in marks:
            assert not (low.real < mark.real < high.real and low.imag < mark.imag < high.imag), gid


def _box(label: ET.Element) -> tuple[complex, complex]:
    """The corners of the letters of a label."""
    data = next(element.attrib["d"] for element in label.iter() if element.tag.endswith("}path"))
    values = [float(word) for word in data.split() if not word.isalpha()]
    return complex(min(values[::2]), min(values[1::2])), complex(max(values[::2]), max(values[1::2]))


def _mark(group: ET.Element) -> complex:
    use = next(element for element in group.iter() if element.tag.endswith("}use"))
    return complex(float(use.attrib["x"]), float(use.attrib["y"]))


def test_pyplot_is_never_loaded(tmp_path, pytestconfig):
    code = (
        "import pathlib, sys\nfrom gcs.reports.figure import draw_plan\nfrom planner.plan import RelayPlan\n"
        "draw_plan(RelayPlan('paper', (), 0.0, 0.0, 0.0), {'L0': 0j}, pathlib.Path(sys.argv[1]))\n"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "plan.png")]
    subprocess.run(command, check=True, cwd=pytestconfig.rootpath)


def test_the_plan_drawn_may_have_no_route(tmp_path):
    empty = replace(_plan(), routes=())
    draw_plan(empty, TRANSMITTERS, tmp_path / "plan.svg")
    assert "transmitter-L1" in _ids(tmp_path / "plan.svg")
