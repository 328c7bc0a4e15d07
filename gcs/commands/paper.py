"""`paper`: the paper's tables and figures, recomputed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gcs.paper.plots import draw_paper_figures
from gcs.paper.render import print_paper


def paper(
    plots: Annotated[Path | None, typer.Option(help="redraw figures 9 and 10 into this folder")] = None,
) -> None:
    """Recompute the paper's tables 2 to 6 beside the printed numbers."""
    console = Console()
    agrees = print_paper(console)
    if plots is not None:
        for path in draw_paper_figures(plots):
            console.print(f"figure {path}", soft_wrap=True)
    if not agrees:
        raise typer.Exit(1)
