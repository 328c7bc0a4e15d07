"""The paper's figures redrawn: what they contain; never their pixels."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from gcs.errors import ServiceError
from gcs.paper.plots import draw_paper_figures
from gcs.paper.printed import PRINTED

NAMES = ["figure_9.svg", "figure_10a.svg", "figure_10b.svg", "figure_10c.svg", "figure_10d.svg"]


@pytest.fixture(scope="module")
def figures(tmp_path_factory) -> dict[str, Path]:
    paths = draw_paper_figures(tmp_path_factory.mktemp("paper") / "new" / "folder")
    return {path.name: path for path in paths}


def _ids(path: Path) -> set[str]:
    return {element.attrib["id"] for element in ET.parse(path).iter() if "id" in element.attrib}


def _mark(path: Path, gid: str) -> tuple[float, float]:
    group = next(element for element in ET.parse(path).iter() if element.attrib.get("id") == gid)
    use = next(element for element in group.iter() if element.tag.endswith("}use"))
    return float(use.attrib["x"]), float(use.attrib["y"])


def test_the_five_files_are_written_and_returned_in_order(figures):
    assert list(figures) == NAMES
    assert all(path.is_file() for path in figures.values())


def test_figure_9_has_the_triangle_the_target_and_the_seven_places(figures):
    ids = _ids(figures["figure_9.svg"])
    cases = [case.name for case in PRINTED.table_2.cases]
    assert len(cases) == 7
    assert {"triangle", "target-O", "label-target-O", "legend"} <= ids
    assert {f"{kind}transmitter-{corner}" for kind in ("", "label-") for corner in "ABC"} <= ids
    assert {f"{kind}case-{case}" for kind in ("", "label-") for case in cases} <= ids
    assert {f"sight-{corner}-{case}" for corner in "ABC" for case in cases} <= ids


def test_figure_9_places_the_cases_as_they_are_named(figures):
    path = figures["figure_9.svg"]
    a, b, c = (_mark(path, f"transmitter-{corner}") for corner in "ABC")
    left, right, down, inside = (_mark(path, f"case-{case}") for case in ("Left", "Right", "Down", "Inside"))
    assert a[1] == b[1]
    assert left[0] < a[0] < inside[0] < b[0] < right[0]
    assert c[1] < inside[1] < a[1] < down[1], "downwards on the page is +y of an SVG"


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("figure_10a.svg", "Figure 10 a, model I: total length 616.50 m"),
        ("figure_10b.svg", "Figure 10 b, model II: total length 571.27 m"),
        ("figure_10c.svg", "Figure 10 c, two-step strategy: total length 491.59 m"),
        ("figure_10d.svg", "Figure 10 d, geometric optimisation (reconstructed): total length 494.57 m"),
    ],
)
def test_the_titles_of_figure_10_say_strategy_and_total(figures, name, title):
    assert f"<!-- {title} -->" in figures[name].read_text()


def test_the_plans_of_figure_10_have_all_their_legs_and_10d_its_descents(figures):
    receivers = [row.receiver for row in PRINTED.table_3.rows]
    for name in NAMES[1:4]:
        assert {f"leg-{number}-{receiver}" for number in (1, 2) for receiver in receivers} <= _ids(figures[name])
    ids = _ids(figures["figure_10d.svg"])
    assert {f"{kind}-{receiver}" for kind in ("descent", "steps", "start") for receiver in receivers} <= ids
    assert {f"slot-O{number}" for number in range(1, 9)} <= ids


def test_the_four_of_figure_10_share_their_axes(figures):
    spans = []
    for name in NAMES[1:]:
        low, high = _mark(figures[name], "transmitter-L0"), _mark(figures[name], "transmitter-L1")
        spans.append(high[0] - low[0])
        assert f"<!-- {'−150'} -->" in figures[name].read_text()
    assert spans == pytest.approx([spans[0]] * 4, rel=0.02)


def test_a_folder_that_cannot_be_made_is_named_with_the_reason(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ServiceError, match=r"file/plots: the folder cannot be made: Not a directory"):
        draw_paper_figures(tmp_path / "file" / "plots")
