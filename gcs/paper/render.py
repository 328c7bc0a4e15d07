"""Prints the recomputed tables beside the printed ones: `bearing-relay paper`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from string import ascii_lowercase

from rich import box
from rich.console import Console
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from gcs.paper.comparison import (
    EXACT_BOUND_M,
    ROUNDED_BOUND_M,
    TOLERANCE_M,
    Comparison,
    LegsComparison,
    LengthResult,
    LengthsResult,
    ModelsResult,
    PaperComparison,
    Passage,
    PositioningResult,
)
from gcs.paper.printed import PRINTED, Polar, PrintedPaper
from gcs.paper.tables import FLYABLE_SEPARATION_M, recompute
from planner.plan import RelayPlan

_THROUGH_M = 1e-6
_INTRODUCTION = (
    "printed: as in the paper. here: recomputed by this planner. diff: here - printed. A letter marks a printed error "
    "or a route that comes too near a transmitter, explained below its table. Lengths in the paper's units, taken as "
    "metres."
)
_QUOTED = "geometric: the geometric optimization the paper compares with, quoted from print, not recomputed."


def print_paper(console: Console, printed: PrintedPaper = PRINTED) -> bool:
    """Print tables 2 to 6 recomputed beside print; return whether all of it agrees, marked printed errors aside."""
    paper = recompute(printed)
    _say(console, _INTRODUCTION)
    _print_positioning(console, paper.table_2)
    _print_lengths(console, "Table 3. Lengths, eight UAVs", paper.table_3)
    _print_lengths(console, "Table 4. Lengths, twenty UAVs", paper.table_4)
    _print_flyable(console, paper)
    _print_strategies(console, paper)
    _print_models(console, paper)
    _head(console, "Verdict")
    agrees = f"Every row lies within {TOLERANCE_M} of print, marked printed errors aside; table 2 keeps its bounds."
    differs = f"NOT as printed: a row marked ! is off by more than {TOLERANCE_M}, or a statement says NO."
    _say(console, agrees if paper.holds else differs, "bold green" if paper.holds else "bold red")
    return paper.holds


class _Notes:
    """Footnotes of one table; `add` returns the letter that stands for a text."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, text: str) -> str:
        self.texts.append(text)
        return ascii_lowercase[len(self.texts) - 1]

    def print_on(self, console: Console) -> None:
        grid = Table.grid(padding=(0, 1))
        for letter, text in zip(ascii_lowercase, self.texts, strict=False):
            grid.add_row(Text(letter, "bold yellow"), Text(text))
        console.print(grid)


def _print_positioning(console: Console, rows: Iterable[PositioningResult]) -> None:
    _head(console, "Table 2. Two-circle positioning")
    table = _table("case", "position", "printed\nestimate", "print\nerror", "exact\nangles", "0.01°\nangles", "fits")
    for row in rows:
        case = row.printed
        radii = (f"{case.error_radius:.4f}", f"{row.exact_m:.1e}", f"{row.rounded_m:.4f}")
        fits = Text(f"{row.candidates}{'' if row.holds else ' !'}", "" if row.holds else "bold red")
        table.add_row(case.name, _polar(case.position, 2), _polar(case.estimate, 4), *radii, fits)
    console.print(table)
    _say(
        console,
        "Error radii (eq. 25): print error, of the printed estimate; recomputed from exact angles, below "
        f"{EXACT_BOUND_M:g}; from angles rounded to 0.01 degree, below {ROUNDED_BOUND_M:g}, the size of the printed "
        "ones. fits: positions that fit the unsigned angles alpha and beta; their signs leave one.",
    )


def _print_lengths(console: Console, title: str, result: LengthsResult) -> None:
    _head(console, title)
    notes = _Notes()
    table = _table("UAV", "model", "printed", "here", "diff", "straight\nline", "geometric\n(quoted)", "note")
    for row in result.rows:
        marks = " ".join(notes.add(text) for text in _length_notes(row, result))
        lines = (f"{row.straight_line_m:.2f}", f"{row.geometric_m:.2f}", marks)
        table.add_row(row.receiver, row.passages[0].model, *_cells(row.length), *lines)
    table.add_section()
    straight_m = sum(row.straight_line_m for row in result.rows)
    totals = (f"{straight_m:.2f}", f"{result.geometric_column.printed:.2f}", _mark(result.geometric_column.holds))
    table.add_row("total", "", *_cells(result.two_step), *totals)
    console.print(table)
    notes.print_on(console)
    plan, count = result.plan, len(result.rows)
    on_circle = result.slots_off_m <= TOLERANCE_M
    _say(console, _QUOTED)
    summed = f"Printed total = sum of the printed lengths: {_yes(result.two_step_column.holds)}."
    _say(console, f"{summed} Each is rounded, so it may be off by half a last digit a row.")
    _say(console, f"Printed slots = places 1 to {count} of a circle of {count + 1}: {_yes(on_circle)}.")
    _say(
        console,
        f"Hungarian assignment = identity: {_yes(result.assignment_is_identity)}. Total {plan.total_length_m:.2f} with "
        f"separation off; straight-line bound over all assignments {plan.straight_line_bound_m:.2f}.",
        "bold",
    )


def _length_notes(row: LengthResult, result: LengthsResult) -> Iterable[str]:
    if row.length.misprint_for is not None:
        yield (
            f"{row.receiver}: {row.length.printed:.2f}, the length of U6 in table 4, is a misprint for "
            f"{row.length.misprint_for:.2f} (table 6), with which the column sums to the printed total "
            f"{result.two_step.printed:.2f}."
        )
    if row.quoted_too_short:
        yield (
            f"{row.receiver}: the quoted {row.geometric_m:.2f} is shorter than the straight line "
            f"{row.straight_line_m:.2f}: it cannot reach the slot."
        )
    flown, other = row.passages
    if flown.distance_m < FLYABLE_SEPARATION_M:
        yield (
            f"{row.receiver}: the shorter {_passage(flown)} ({_passage(other)}): infeasible at separation "
            f"{FLYABLE_SEPARATION_M:g}."
        )


def _passage(passage: Passage) -> str:
    through = passage.distance_m < _THROUGH_M
    how = "flies straight through" if through else f"passes {passage.distance_m:.2f} from"
    return f"model {passage.model} {how} {passage.guide}"


def _print_flyable(console: Console, paper: PaperComparison) -> None:
    plan: RelayPlan = paper.flyable
    slot_of = {route.receiver: route.slot for route in plan.routes}
    assignment = ", ".join(f"{row.receiver}->{slot_of[row.receiver]}" for row in paper.table_4.rows)
    _say(
        console,
        f"Flyable chain, separation {FLYABLE_SEPARATION_M:g}: total {plan.total_length_m:.2f}, not "
        f"{paper.table_4.plan.total_length_m:.2f}.",
        "bold",
    )
    _say(console, f"Its assignment: {assignment}.")


def _print_strategies(console: Console, paper: PaperComparison) -> None:
    _head(console, "Table 5. Strategies, eight UAVs")
    geometric, two_step = paper.printed.table_5
    notes = _Notes()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for header in ("", "geometric\n(quoted)", "two-step\nprinted", "two-step\nhere", "diff", "note"):
        table.add_column(header)
    table.add_row("total length", f"{geometric.total:.2f}", *_cells(paper.table_5), "")
    mark = notes.add("The routes are O(n); the paper's own Hungarian assignment is O(n^3).")
    table.add_row("complexity", geometric.complexity, two_step.complexity, "O(n^3)", "", mark)
    table.add_row("optimization", geometric.optimization, two_step.optimization, two_step.optimization, "", "")
    console.print(table)
    notes.print_on(console)


def _print_models(console: Console, paper: PaperComparison) -> None:
    columns: tuple[tuple[str, Callable[[ModelsResult], LegsComparison], Comparison], ...] = (
        ("Table 6. Model I, eight UAVs", lambda row: row.model_1, paper.table_6.model_1),
        ("Table 6. Model II, eight UAVs", lambda row: row.model_2, paper.table_6.model_2),
        ("Table 6. Two-step choice, eight UAVs", lambda row: row.two_step, paper.table_6.two_step),
    )
    for title, legs_of, total in columns:
        chosen = legs_of is columns[-1][1]
        _head(console, title)
        triples = [header for part in ("leg 1", "leg 2", "total") for header in (f"{part}\nprinted", "here", "diff")]
        table = _table("UAV", *triples)
        for row in paper.table_6.rows:
            legs = legs_of(row)
            cells = [cell for part in (legs.first, legs.second, legs.total) for cell in _cells(part)]
            table.add_row(f"{row.receiver} {row.chosen}" if chosen else row.receiver, *cells)
        table.add_section()
        table.add_row("total", *[""] * 6, *_cells(total))
        console.print(table)


def _table(first: str, *others: str) -> Table:
    """Return a table of right-aligned columns after the first that fits 80 characters."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column(first, no_wrap=True)
    for header in others:
        table.add_column(header, justify="right", no_wrap=True)
    return table


def _cells(length: Comparison) -> tuple[str, str, Text]:
    style = "green" if length.holds and length.misprint_for is None else "yellow" if length.holds else "bold red"
    difference = f"{length.difference:+.3f}" if length.holds else f"{length.difference:+.2f}!"
    return f"{length.printed:.2f}", f"{length.recomputed:.2f}", Text(difference, style)


def _polar(place: Polar, decimals: int) -> str:
    return f"{place[0]:.{decimals}f}, {place[1]:.{decimals}f}°"


def _mark(holds: bool) -> Text:
    return Text("" if holds else "!", "bold red")


def _yes(holds: bool) -> str:
    return "yes" if holds else "NO"


def _head(console: Console, title: str) -> None:
    console.print()
    console.print(Rule(title))


def _say(console: Console, text: str, style: str = "") -> None:
    console.print(Text(text, style))
