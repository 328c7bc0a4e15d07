"""The golden record of a fault campaign: what its thousand runs found, and what became of a few of them.

To make it anew, after a change that makes runs end otherwise:

    bearing-relay faults tests/gcs/faults/campaign.yaml --runs 1000 --seed 0 --json found.json
    python -m tests.gcs.faults.golden found.json
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any, Final

import msgspec

from gcs.faults.outcome import FaultRun, fly_with_faults
from gcs.playbook.loader import load_playbook

FOLDER: Final = Path(__file__).parent
PLAYBOOK: Final = FOLDER / "campaign.yaml"
GOLDEN: Final = FOLDER / "golden_campaign.json"
PYPROJECT: Final = FOLDER.parents[2] / "pyproject.toml"
COMMAND: Final = "bearing-relay faults tests/gcs/faults/campaign.yaml --runs 1000 --seed 0 --json found.json"
SEEDS: Final = (2, 7, 21, 42, 80, 333, 512, 999)


def told(run: FaultRun) -> dict[str, Any]:
    """Return what became of a run, in words: measured numbers may differ in their last digits between machines."""
    return {
        "seed": run.seed,
        "attended": run.attended,
        "faults": [f"{fault.kind} {fault.target}" for fault in run.faults],
        "struck": [at_s is not None for at_s in run.struck_s],
        "outcome": run.outcome,
        "reason": re.sub(r"\d+(?:\.\d+)?(?= (?:s|m)\b)", "#", run.reason),
        "wrong_placements": run.wrong_placements,
        "violations": [msgspec.to_builtins(finding) for finding in run.violations],
    }


def main(found: Path) -> None:
    """Write the record from what the command found, flying a few of its runs once more."""
    playbook = load_playbook(PLAYBOOK)
    plan = playbook.plan()
    record = {
        "command": COMMAND,
        "version": tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["version"],
        **json.loads(found.read_text(encoding="utf-8")),
        "some": [told(fly_with_faults(playbook, plan, seed)) for seed in SEEDS],
    }
    GOLDEN.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
