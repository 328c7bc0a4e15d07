"""Prints the recomputed tables beside the printed ones: `bearing-relay paper`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from rich import box
from rich.console import Console
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
from gcs.paper.layout import Notes, cells, head, mark, polar, say, table_of, yes
from gcs.paper.printed import PRINTED, PrintedPaper
from gcs.paper.tables import FLYABLE_SEPARATION_M, recompute
from planner.plan import RelayPlan

_THROUGH_M = 1e-6
_INTRODUCTION = (
    "printed: as in the paper. here: recomputed by this planner. diff: here - printed. A letter marks a printed error "
    "or a route that comes too near a transmitter, explained below its table. Lengths in the paper's units, taken as "
    "metres."
)
_POSITIONING = ("two-circle", "trilateration")
_TRILATERATION = (
    "trilateration: reconstructed, as the paper prints no numbers: the position at the radii of the three circles of "
    "alpha, beta and the angle BDC about their centres. In line with two transmitters it has none; two-circle "
    "positioning has."
)
_GEOMETRIC = ("geometric\n(quoted)", "geometric\nhere")


def print_paper(console: Console, printed: PrintedPaper = PRINTED) -> bool:
    """Print tables 2 to 6 recomputed beside print; return whether all of it agrees, marked printed errors aside."""
    paper = recompute(printed)
    say(console, _INTRODUCTION)
    _print_positioning(console, paper.table_2)
    _print_lengths(console, "Table 3. Lengths, eight UAVs", paper.table_3)
    _print_lengths(console, "Table 4. Lengths, twenty UAVs", paper.table_4)
    _print_flyable(console, paper)
    _print_strategies(console, paper)
    _print_models(console, paper)
    head(console, "Verdict")
    agrees = f"Every row lies within {TOLERANCE_M} of print, marked printed errors aside; table 2 keeps its bounds."
    differs = f"NOT as printed: a row marked ! is off by more than {TOLERANCE_M}, or a statement says NO."
    say(console, agrees if paper.holds else differs, "bold green" if paper.holds else "bold red")
    return paper.holds


def _print_positioning(console: Console, rows: Sequence[PositioningResult]) -> None:
    head(console, "Table 2. Two-circle positioning")
    table = table_of("case", "position", "printed\nestimate", "print\nerror", "exact\nangles", "0.01°\nangles", "fits")
    for row in rows:
        case = row.printed
        radii = (f"{case.error_radius:.4f}", f"{row.exact_m:.1e}", f"{row.rounded_m:.4f}")
        fits = Text(f"{row.candidates}{'' if row.holds else ' !'}", "" if row.holds else "bold red")
        table.add_row(case.name, polar(case.position, 2), polar(case.estimate, 4), *radii, fits)
    console.print(table)
    say(
        console,
        "Error radii (eq. 25): print error, of the printed estimate; recomputed from exact angles, below "
        f"{EXACT_BOUND_M:g}; from angles rounded to 0.01 degree, below {ROUNDED_BOUND_M:g}, the size of the printed "
        "ones. fits: positions that fit the unsigned angles alpha and beta; their signs leave one.",
    )
    both = table_of("error radius here", *(f"{how}\n{angles}" for how in _POSITIONING for angles in ("exact", "0.01°")))
    for row in rows:
        errors = (row.exact_m, row.rounded_m, row.trilateration_exact_m, row.trilateration_rounded_m)
        both.add_row(
            row.printed.name, *(f"{radius:.1e}" if radius < EXACT_BOUND_M else f"{radius:.4f}" for radius in errors)
        )
    console.print(both)
    say(console, _TRILATERATION)


def _print_lengths(console: Console, title: str, result: LengthsResult) -> None:
    head(console, title)
    notes = Notes()
    table = table_of("UAV", "model", "printed", "here", "diff", "straight\nline", *_GEOMETRIC, "note")
    for row in result.rows:
        letters = " ".join(notes.add(text) for text in _length_notes(row, result))
        lines = (row.straight_line_m, row.geometric_m, row.geometric_here.length_m)
        table.add_row(
            row.receiver, row.passages[0].model, *cells(row.length), *(f"{line:.2f}" for line in lines), letters
        )
    table.add_section()
    straight_m = sum(row.straight_line_m for row in result.rows)
    totals = [f"{total:.2f}" for total in (straight_m, result.geometric_column.printed, result.geometric_here_m)]
    table.add_row("total", "", *cells(result.two_step), *totals, mark(result.geometric_column.holds))
    console.print(table)
    notes.print_on(console)
    plan, count = result.plan, len(result.rows)
    on_circle = result.slots_off_m <= TOLERANCE_M
    say(console, _reconstruction(result))
    summed = f"Printed total = sum of the printed lengths: {yes(result.two_step_column.holds)}."
    say(console, f"{summed} Each is rounded, so it may be off by half a last digit a row.")
    say(console, f"Printed slots = places 1 to {count} of a circle of {count + 1}: {yes(on_circle)}.")
    say(
        console,
        f"Hungarian assignment = identity: {yes(result.assignment_is_identity)}. Total {plan.total_length_m:.2f} with "
        f"separation off; straight-line bound over all assignments {plan.straight_line_bound_m:.2f}.",
        "bold",
    )


def _reconstruction(result: LengthsResult) -> str:
    quoted_m, here_m = result.geometric_column.printed, result.geometric_here_m
    short = ", ".join(row.receiver for row in result.rows if row.quoted_too_short)
    never = f"; a descent that reaches its slot cannot be as short as the quoted {short}" if short else ""
    return (
        "geometric: the geometric optimization the paper compares with, quoted from print, and here reconstructed "
        "(gradient descent on the squared error of the bearings of the same two guides; sum of the steps, "
        f"{result.mean_steps:.1f} on average). It does not reproduce print: {here_m:.2f}, {here_m / quoted_m:.0%} of "
        f"{quoted_m:.2f}. The paper gives no step rule{never}."
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
    say(
        console,
        f"Flyable chain, separation {FLYABLE_SEPARATION_M:g}: total {plan.total_length_m:.2f}, not "
        f"{paper.table_4.plan.total_length_m:.2f}.",
        "bold",
    )
    say(console, f"Its assignment: {assignment}.")


def _print_strategies(console: Console, paper: PaperComparison) -> None:
    head(console, "Table 5. Strategies, eight UAVs")
    geometric, two_step = paper.printed.table_5
    notes = Notes()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("", no_wrap=True)
    for header in (*_GEOMETRIC, "two-step\nprinted", "two-step\nhere", "diff", "note"):
        table.add_column(header)
    here = paper.table_3
    table.add_row("total length", f"{geometric.total:.2f}", f"{here.geometric_here_m:.2f}", *cells(paper.table_5), "")
    letter = notes.add("The routes are O(n); the paper's own Hungarian assignment is O(n^3).")
    table.add_row("complexity", *[geometric.complexity] * 2, two_step.complexity, "O(n^3)", "", letter)
    table.add_row("steps, mean k", "over 12", f"{here.mean_steps:.1f}", "2", "2", "", "")
    table.add_row("optimization", *[geometric.optimization] * 2, *[two_step.optimization] * 2, "", "")
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
        head(console, title)
        triples = [header for part in ("leg 1", "leg 2", "total") for header in (f"{part}\nprinted", "here", "diff")]
        table = table_of("UAV", *triples)
        for row in paper.table_6.rows:
            legs = legs_of(row)
            lengths = [cell for part in (legs.first, legs.second, legs.total) for cell in cells(part)]
            table.add_row(f"{row.receiver} {row.chosen}" if chosen else row.receiver, *lengths)
        table.add_section()
        table.add_row("total", *[""] * 6, *cells(total))
        console.print(table)
