"""Slots in a table (CSV): a header that names the columns, then a row for each slot, in relay order."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gcs.playbook.slot_files.slots import FoundSlot, Problem, SlotFileError, number, on_globe, read_text

_PLANE: Final = ("x", "y")
_GLOBE: Final = ("lat", "lon")
_ALLOWED: Final = "columns are x, y (metres) or lat, lon (degrees), and name if the slots have their own"


def read_table(path: Path) -> list[FoundSlot]:
    """Return the slots of a table; SlotFileError with everything wrong in it."""
    rows = _rows(path)
    first, header = next(rows, (1, []))
    columns = [cell.strip().lower() for cell in header]
    if sorted({*columns} - {"name"}) not in (sorted(_PLANE), sorted(_GLOBE)) or len({*columns}) != len(columns):
        raise SlotFileError(path, [Problem(first, f"the first line is {', '.join(columns) or 'empty'}: {_ALLOWED}")])
    found: list[FoundSlot] = []
    problems: list[Problem] = []
    for line, row in rows:
        try:
            if len(row) != len(columns):
                raise ValueError(f"{len(row)} values in {len(columns)} columns")
            found.append(_slot(line, dict(zip(columns, row, strict=True))))
        except ValueError as error:
            problems.append(Problem(line, str(error)))
    if problems:
        raise SlotFileError(path, problems)
    return found


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows in which anything stands, with their lines."""
    lines = read_text(path).splitlines()
    header = next((line for line in lines if line.strip()), "")
    reader = csv.reader(lines, delimiter=";" if ";" in header else ",", strict=True)
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, row
    except csv.Error as error:
        raise SlotFileError(path, [Problem(reader.line_num, f"is no CSV: {error}")]) from error


def _slot(line: int, cells: dict[str, str]) -> FoundSlot:
    name = cells.get("name", "").strip() or None
    if "x" in cells:
        return FoundSlot(line, name, complex(number(cells["x"]), number(cells["y"])))
    return on_globe(line, name, cells["lat"], cells["lon"])
