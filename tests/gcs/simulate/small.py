"""A small relay that is flown in a second: one receiver, or two."""

from __future__ import annotations

from pathlib import Path

from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook

SMALL = """\
playbook: 1
name: small
formation: {{kind: custom, slots: {{O1: [70, 60]{slots}}}}}
transmitters:
  L0: {{at: [0, 0]}}
  L1: {{at: [100, 0]}}
receivers:
  U1: {{start: [40, 40]}}
{receivers}flight: {{altitude_m: 4, speed_mps: 4, give_up_s: {give_up_s}}}
{more}"""


def small_text(more: str = "", *, two: bool = False, give_up_s: float = 2.0) -> str:
    """Return the playbook; `more` is more YAML."""
    receivers = "  U2: {start: [60, -30]}\n" if two else ""
    return SMALL.format(slots=", O2: [70, -60]" if two else "", receivers=receivers, more=more, give_up_s=give_up_s)


def small(folder: Path, more: str = "", *, two: bool = False, give_up_s: float = 2.0) -> Playbook:
    """Load the playbook from a file in a folder."""
    path = folder / "small.yaml"
    path.write_text(small_text(more, two=two, give_up_s=give_up_s), encoding="utf-8")
    return load_playbook(path)
