"""Stops the process that started it for a while, as a machine that hangs would, and lets it go on.

It is a process of its own: whoever stands still cannot end that.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time


def main() -> None:
    """Run as `python -m drivers.simulation.freezer PARENT_PID SECONDS`; told to end, it lets it go on first."""
    pid, for_s = int(sys.argv[1]), float(sys.argv[2])
    if os.getppid() != pid:
        sys.exit("who was to be stopped has already ended")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        os.kill(pid, signal.SIGSTOP)
        time.sleep(for_s)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


if __name__ == "__main__":
    main()
