"""A screen lets every other process go first."""

from __future__ import annotations

import os
import subprocess
import sys

from gcs.monitor.yielding import NICENESS


def test_who_gives_way_is_nicer_than_before() -> None:
    program = "import os; from gcs.monitor.yielding import give_way; give_way(); print(os.nice(0))"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert int(said) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICENESS, 19)
