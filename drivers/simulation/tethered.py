"""Becomes a program of somebody else's that ends with this process's parent, however the parent ends.

The embedded copters watch their parent themselves; an autopilot's own simulator does not.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1


def main() -> None:
    """Run as `python -m drivers.simulation.tethered PARENT_PID PROGRAM [ARGUMENT ...]`."""
    parent_pid, program, *arguments = sys.argv[1:]
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent_pid):
        sys.exit(f"{program}: its parent has already ended")
    try:
        os.execv(program, [program, *arguments])  # noqa: S606 - the user's own simulator, no shell
    except OSError as error:
        sys.exit(f"{program} cannot be run: {error}")


if __name__ == "__main__":
    main()
