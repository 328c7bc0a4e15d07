"""Charts and markup: ticks are round, lines break where nothing is known, text is never markup."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.reports.chart import Level, Line, Panel, draw, spread, ticks
from gcs.reports.markup import element, table

FINITE = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 10.0, ["0", "2", "4", "6", "8", "10"]),
        (69.95, 70.05, ["69.96", "69.98", "70.00", "70.02", "70.04"]),
        (-180.0, 180.0, ["-100", "0", "100"]),
        (3.0, 3.0, []),
    ],
)
def test_ticks_are_round(low: float, high: float, expected: list[str]) -> None:
    assert [text for _, text in ticks(low, high)] == expected


def test_logarithmic_ticks_are_powers_of_ten() -> None:
    assert [text for _, text in ticks(0.02, 130.0, logarithmic=True)] == ["0.1", "1", "10", "100"]


@given(st.lists(FINITE, min_size=1, max_size=20))
def test_a_spread_shows_every_value_and_has_a_width(values: list[float]) -> None:
    low, high = spread(values)
    assert low < min(values)
    assert high > max(values)
    assert all(low <= at <= high for at, _ in ticks(low, high))


@given(st.lists(st.tuples(FINITE, st.none() | st.floats()), max_size=20))
def test_a_line_never_leaves_its_picture_and_holds_only_numbers(points: list[tuple[float, float | None]]) -> None:
    panel = Panel((-1e6, 1e6), (-10.0, 10.0), "x", "y", [Line(points, "a", "b")], [Level(0.0, "c", "d", -1.0, 1.0)])
    for path in re.findall(r' d="([^"]*)"', draw(panel, "title")):
        for x, y in re.findall(r"(-?[\d.]+),(-?[\d.]+)", path):
            assert 0.0 <= float(x) <= panel.width
            assert 0.0 <= float(y) <= panel.height
        assert "nan" not in path
        assert "inf" not in path


def test_a_line_breaks_where_nothing_is_known() -> None:
    points = [(0.0, 1.0), (1.0, 1.0), (2.0, None), (3.0, math.nan), (4.0, 1.0)]
    drawn = draw(Panel((0.0, 4.0), (0.0, 2.0), "x", "y", [Line(points, "a", "b")]), "title")
    (path,) = re.findall(r' d="([^"]*)"', drawn)
    assert path.count("M") == 2


def test_a_long_line_keeps_its_last_point() -> None:
    points = [(float(x), float(x % 7)) for x in range(10_000)]
    drawn = draw(Panel((0.0, 9_999.0), (0.0, 7.0), "x", "y", [Line(points, "a", "b")]), "title")
    (path,) = re.findall(r' d="([^"]*)"', drawn)
    assert len(path.split()) < 600
    assert path.split()[-1].startswith("470.0,")


def test_text_and_attributes_are_escaped_once_and_elements_are_not() -> None:
    assert element("p", "<&>", element("b", "'\""), title='"><') == (
        '<p title="&quot;&gt;&lt;">&lt;&amp;&gt;<b>&#x27;&quot;</b></p>'
    )
    assert element("meta", charset="utf-8", http_equiv=None) == '<meta charset="utf-8">'
    assert "<td>&lt;i&gt;</td>" in table(["a"], [["<i>"]])
