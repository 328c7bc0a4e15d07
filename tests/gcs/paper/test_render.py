"""What `bearing-relay paper` shows, and when it fails."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from rich.console import Console

from gcs.paper.printed import PRINTED, PrintedPaper
from gcs.paper.render import print_paper


def _shown(width: int, printed: PrintedPaper = PRINTED) -> tuple[bool, str]:
    console = Console(width=width, file=io.StringIO(), record=True)
    holds = print_paper(console, printed)
    return holds, console.export_text()


@pytest.fixture(scope="module", params=[80, 100, 120])
def shown(request):
    return request.param, *_shown(request.param)


@pytest.fixture(scope="module")
def words():
    """The text without its line breaks."""
    return " ".join(_shown(100)[1].split())


def test_it_holds_and_fits_the_width_without_cutting_a_cell(shown):
    width, holds, text = shown
    assert holds
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width


def test_every_row_of_every_table_is_there(shown):
    _, _, text = shown
    lines = [line.split() for line in text.splitlines()]
    for table in (PRINTED.table_3, PRINTED.table_4):
        for row in table.rows:
            assert [row.receiver, f"{row.two_step:.2f}", f"{row.geometric:.2f}"] in [
                [*line[:1], *line[2:3], *line[6:7]] for line in lines
            ]
    for row in PRINTED.table_6.rows:
        for legs in (row.model_1, row.model_2):
            cells = [f"{length:.2f}" for length in (legs.first, legs.second, legs.total)]
            assert [row.receiver, *cells] in [[*line[:1], *line[1:10:3]] for line in lines]
    for case in PRINTED.table_2.cases:
        assert any(line.startswith(case.name) and f"{case.error_radius:.4f}" in line for line in text.splitlines())


@pytest.mark.parametrize(
    "statement",
    [
        "Hungarian assignment = identity: yes. Total 491.59 with separation off",
        "Hungarian assignment = identity: yes. Total 830.42 with separation off",
        "straight-line bound over all assignments 364.18",
        "straight-line bound over all assignments 687.00",
        "Flyable chain, separation 5: total 951.32, not 830.42",
        "U1->O16, U2->O1, U3->O2",
        "U16->O15, U17->O17, U18->O18, U19->O19, U20->O20",
        "U6: 45.34, the length of U6 in table 4, is a misprint for 42.74 (table 6)",
        "U2: the quoted 33.26 is shorter than the straight line 59.57",
        "U4: the quoted 51.66 is shorter than the straight line 66.58",
        "U17: the quoted 19.68 is shorter than the straight line 23.92",
        "model I flies straight through L1 (model II flies straight through L0)",
        "model I passes 2.38 from U5",
        "quoted from print, and here reconstructed",
        "It does not reproduce print: 494.57, 66% of 753.47. The paper gives no step rule; a descent",
        "that reaches its slot cannot be as short as the quoted U2, U4.",
        "It does not reproduce print: 1414.51, 76% of 1859.19",
        "trilateration: reconstructed",
        "the paper's own Hungarian assignment is O(n^3)",
    ],
)
def test_it_states(words, statement):
    assert statement in words


def test_the_reconstruction_stands_beside_the_quoted_lengths(shown):
    _, _, text = shown
    lines = [line.split() for line in text.splitlines()]
    assert ["U1", "261.64", "66.41"] in [[*line[:1], *line[6:8]] for line in lines]
    assert ["total", "753.47", "494.57"] in [[*line[:1], *line[5:7]] for line in lines]
    assert ["total", "length", "753.47", "494.57"] in [line[:4] for line in lines]
    assert ["Down", "1.3e-14", "0.0066", "1.2e-14", "0.0041"] in [
        [line[0], f"{float(line[1]):.1e}", line[2], f"{float(line[3]):.1e}", line[4]]
        for line in lines
        if len(line) == 5 and line[0] == "Down"
    ]


def _altered(**tables: object) -> PrintedPaper:
    return replace(PRINTED, **tables)


def _with_row(table: str, index: int, **values: object) -> PrintedPaper:
    old = getattr(PRINTED, table)
    rows = list(old.rows)
    rows[index] = replace(rows[index], **values)
    return _altered(**{table: replace(old, rows=tuple(rows))})


def _with_case(index: int, **values: object) -> PrintedPaper:
    cases = list(PRINTED.table_2.cases)
    cases[index] = replace(cases[index], **values)
    return _altered(table_2=replace(PRINTED.table_2, cases=tuple(cases)))


_LEGS = PRINTED.table_6.rows[3].model_2


@pytest.mark.parametrize(
    "altered",
    [
        _with_case(0, error_radius=0.0035),
        _with_row("table_3", 0, two_step=81.89),
        _with_row("table_3", 5, misprint_for=None),
        _with_row("table_3", 2, start=(40.36, 103.93)),
        _with_row("table_3", 2, slot=(100.0, 120.1)),
        _with_row("table_4", 19, two_step=12.60),
        _with_row("table_4", 7, geometric=98.26),
        _altered(table_5=(PRINTED.table_5[0], replace(PRINTED.table_5[1], total=491.68))),
        _with_row("table_6", 3, model_2=_LEGS._replace(first=66.41)),
        _with_row("table_6", 3, two_step=_LEGS._replace(second=16.26)),
        _altered(table_6=replace(PRINTED.table_6, model_1_total=616.60)),
    ],
)
@pytest.mark.parametrize("width", [80, 120])
def test_an_altered_number_fails_and_is_pointed_out(altered, width):
    holds, text = _shown(width, altered)
    assert not holds
    assert "NOT as printed" in text
    assert "!" in text.split("NOT as printed")[0] or ": NO." in text
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text


def test_a_number_altered_within_the_tolerance_still_holds():
    rows = PRINTED.table_6.rows
    assert _shown(80, _with_row("table_6", 0, model_2=rows[0].model_2._replace(first=54.07)))[0]
