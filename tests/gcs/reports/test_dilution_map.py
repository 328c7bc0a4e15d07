"""What the map of dilution contains; never its pixels."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from gcs.errors import ServiceError
from gcs.reports.dilution_map import draw_dilution_map

TWO = {"L0": 0j, "L1": 100 + 0j}
THREE = TWO | {"L2": 50 + 80j}
FIELD = (-150.0, 150.0, -150.0, 150.0)


def _ids(path: Path) -> set[str]:
    return {element.attrib["id"] for element in ET.parse(path).iter() if "id" in element.attrib}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The text of a map."""
    folder = tmp_path_factory.mktemp("maps")

    def draw(transmitters, *, heading_referenced, extent=FIELD, title="") -> tuple[set[str], str]:
        path = folder / "map.svg"
        draw_dilution_map(transmitters, path, extent, heading_referenced, title)
        return _ids(path), path.read_text()

    return draw


def test_bands_contours_transmitters_and_the_degenerate_line(drawn):
    ids, text = drawn(TWO, heading_referenced=True, title="Two")
    assert {"title", "legend", "dilution", "contours", "contour-label-1", "degenerate"} <= ids
    assert {f"{kind}transmitter-{name}" for kind in ("", "label-") for name in TWO} <= ids
    assert "<!-- Two: dilution of bearings from north -->" in text
    assert "<!-- GDOP (m per degree) -->" in text
    assert "<!-- not fixed: over 50 m per degree -->" in text
    assert all(f"<!-- {level} -->" in text for level in ("2", "5", "10", "20", "50"))


def test_the_circle_through_three_transmitters_is_degenerate_without_a_heading(drawn):
    ids, text = drawn(THREE, heading_referenced=False)
    assert {"dilution", "degenerate"} <= ids
    assert "<!-- Dilution of angles between bearings -->" in text


def test_two_transmitters_without_a_heading_fix_nothing_anywhere(drawn):
    ids, text = drawn(TWO, heading_referenced=False)
    assert "degenerate" in ids
    assert "not fixed" in text
    assert not {"dilution", "contours"} & ids


def test_where_all_is_well_nothing_is_hatched(drawn):
    ids, text = drawn(THREE, heading_referenced=True, extent=(-20.0, 120.0, -20.0, 100.0))
    assert "dilution" in ids
    assert "degenerate" not in ids
    assert "not fixed" not in text


def test_a_field_within_one_band_has_no_contours(drawn):
    ids, _ = drawn(THREE, heading_referenced=True, extent=(45.0, 55.0, 25.0, 35.0))
    assert "dilution" in ids
    assert "contours" not in ids


def test_transmitters_beyond_the_field_count_but_are_not_drawn(drawn):
    ids, _ = drawn(THREE, heading_referenced=True, extent=(-50.0, 60.0, -50.0, 60.0))
    assert "transmitter-L0" in ids
    assert not {"transmitter-L1", "label-transmitter-L1", "transmitter-L2"} & ids


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(ServiceError, match=r"must be one of \.svg, \.png, \.pdf"):
        draw_dilution_map(TWO, tmp_path / "map.txt", FIELD, heading_referenced=True)
