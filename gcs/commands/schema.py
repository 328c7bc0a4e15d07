"""`schema`: the JSON Schema of a playbook, for editors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from gcs.playbook.json_schema import playbook_schema
from gcs.recording.run_folder import write_json


def schema(
    out: Annotated[Path | None, typer.Option(help="write it here instead of to the screen")] = None,
) -> None:
    """Print the JSON Schema of a playbook.

    An editor with a YAML language server completes and checks a playbook whose first line is
    `# yaml-language-server: $schema=playbook.schema.json`, beside the file that `--out playbook.schema.json` wrote.
    """
    if out is None:
        typer.echo(json.dumps(playbook_schema(), indent=2))
    else:
        write_json(out, playbook_schema())
