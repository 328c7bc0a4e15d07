"""Rows in columns, as one text: much cheaper to draw, five times a second, than a table that lays itself out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rich.text import Text


@dataclass
class Grid:
    """A head and rows; columns from number `left` on are set to the right. Every row has a style of its own."""

    head: Sequence[str]
    left: int
    rows: list[tuple[Sequence[str], str]] = field(default_factory=list)

    def add(self, cells: Sequence[str], style: str = "") -> None:
        """Add a row; cells beyond those of the head are left out."""
        self.rows.append((cells[: len(self.head)], style))

    def text(self) -> Text:
        """Return all rows under the head, every column as wide as its widest cell."""
        widths = [max(map(len, column)) for column in zip(self.head, *(cells for cells, _ in self.rows), strict=True)]
        lines = [(self.head, "bold"), *self.rows]
        return Text("\n", no_wrap=True).join(
            Text(self._line(cells, widths), style=style, no_wrap=True) for cells, style in lines
        )

    def _line(self, cells: Sequence[str], widths: Sequence[int]) -> str:
        return " ".join(
            cell.ljust(width) if number < self.left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ).rstrip()
