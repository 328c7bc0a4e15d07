"""How the tables of `bearing-relay paper` look: columns, cells, footnotes."""

from __future__ import annotations

from string import ascii_lowercase

from rich import box
from rich.console import Console
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from gcs.paper.comparison import Comparison
from gcs.paper.printed import Polar


class Notes:
    """Footnotes of one table."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, text: str) -> str:
        """Return the letter that stands for a text from now on."""
        self.texts.append(text)
        return ascii_lowercase[len(self.texts) - 1]

    def print_on(self, console: Console) -> None:
        """Print the texts, each after its letter."""
        grid = Table.grid(padding=(0, 1))
        for letter, text in zip(ascii_lowercase, self.texts, strict=False):
            grid.add_row(Text(letter, "bold yellow"), Text(text))
        console.print(grid)


def table_of(first: str, *others: str) -> Table:
    """Return a table of right-aligned columns after the first that fits 80 characters."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column(first, no_wrap=True)
    for header in others:
        table.add_column(header, justify="right", no_wrap=True)
    return table


def cells(length: Comparison) -> tuple[str, str, Text]:
    """Return the printed length, the recomputed one, and their difference in the colour of the verdict."""
    style = "green" if length.holds and length.misprint_for is None else "yellow" if length.holds else "bold red"
    difference = f"{length.difference:+.3f}" if length.holds else f"{length.difference:+.2f}!"
    return f"{length.printed:.2f}", f"{length.recomputed:.2f}", Text(difference, style)


def polar(place: Polar, decimals: int) -> str:
    """Return a place as radius, degrees."""
    return f"{place[0]:.{decimals}f}, {place[1]:.{decimals}f}°"


def mark(holds: bool) -> Text:
    """Return an exclamation mark for what does not hold."""
    return Text("" if holds else "!", "bold red")


def yes(holds: bool) -> str:
    """Return yes, or a loud NO."""
    return "yes" if holds else "NO"


def head(console: Console, title: str) -> None:
    """Print a heading."""
    console.print()
    console.print(Rule(title))


def say(console: Console, text: str, style: str = "") -> None:
    """Print a paragraph, never as markup."""
    console.print(Text(text, style))
