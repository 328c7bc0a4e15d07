"""The dashboard beside a run: a process of its own, so that a run does not notice what happens to it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from drivers.bus.openness import is_loopback
from gcs.errors import ServiceError
from gcs.monitor.access import read_tokens

LOG: Final = "dashboard.log"
_ENDS_WITHIN_S: Final = 3.0


@contextlib.contextmanager
def dashboard_beside(listen: str | None, runs_dir: Path) -> Iterator[str | None]:
    """Serve the dashboard of the newest run at HOST:PORT while the block lasts, and yield its address; None: do not.

    Tokens come from the environment. ServiceError when it may not be served there, or is not installed.
    """
    if listen is None:
        yield None
        return
    if find_spec("nicegui") is None:
        raise ServiceError("the dashboard needs NiceGUI: pip install 'bearing-relay[dashboard]'")
    from gcs.monitor.web.place import listening, place_of  # noqa: PLC0415  # only where it is wanted

    place = place_of(listen)
    if not is_loopback(place.host):
        raise ServiceError(
            f"{place.host} is not loopback: run `bearing-relay dashboard --listen {listen}` beside this, with a "
            "certificate and tokens"
        )
    read_tokens(None, None)  # what is wrong with them is said now, not in a log
    listening(place).close()
    runs_dir.mkdir(parents=True, exist_ok=True)
    arguments = ["--listen", listen, "--runs-dir", str(runs_dir), "--parent-pid", str(os.getpid())]
    with (runs_dir / LOG).open("wb") as log:
        process = subprocess.Popen(  # noqa: S603  # this very program
            [sys.executable, "-m", "gcs.cli", "dashboard", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,  # a Ctrl-C in the terminal is the run's to handle
        )
    try:
        yield place.url
    finally:
        process.terminate()
        try:
            process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
