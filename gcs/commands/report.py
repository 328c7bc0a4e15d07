"""`report`: report.html made anew from a run's folder, and several runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gcs.reports.comparison import write_comparison
from gcs.reports.page import write_report

Runs = Annotated[list[Path], typer.Argument(help="folders of runs, as in runs/", metavar="RUN...")]


def report(
    runs: Runs,
    out: Annotated[Path, typer.Option(help="where several runs are compared")] = Path("comparison.html"),
) -> None:
    """Make report.html of each run anew from what it recorded; of several runs also one page that compares them."""
    console = Console()
    for run in runs:
        console.print(f"report {write_report(run)}", soft_wrap=True, markup=False, highlight=False)
    if len(runs) > 1:
        console.print(f"comparison {write_comparison(runs, out)}", soft_wrap=True, markup=False, highlight=False)
