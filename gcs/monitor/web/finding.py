"""Where the run is that the dashboard shows: the one named, or the newest one, whichever that is by now."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from drivers.bus.keys import NAME_PATTERN
from gcs.errors import ServiceError
from gcs.recording.bus_address import BusAddress, address_of, newest_run

REPORT_FILE = "report.html"


@dataclass
class RunFinder:
    """Finds the run: at `connect` when given, else that of the folder `run`, else the newest in `runs_dir`."""

    runs_dir: Path
    run: Path | None = None
    connect: str | None = None
    swarm: str | None = None
    """Without it the only one on that bus."""
    insecure: bool = False
    """Whether strangers may be on that bus."""
    folder: Path | None = None
    """The folder of the run found last, when it is on this machine."""

    def __post_init__(self) -> None:
        if self.run is not None and not self.run.is_dir():
            raise ServiceError(f"{self.run} is no run folder: --run takes one of {self.runs_dir}/")
        if self.swarm is not None and re.fullmatch(NAME_PATTERN, self.swarm) is None:
            raise ServiceError(f"{self.swarm!r} is no name of a swarm: --swarm takes the playbook's name")

    def find(self) -> BusAddress:
        """Return where the run's bus is. ServiceError when there is none yet."""
        if self.connect is not None:
            return BusAddress(self.connect, self.swarm or "", self.insecure)
        self.folder = self.run or newest_run(self.runs_dir)
        found = address_of(self.folder)
        return BusAddress(found.endpoint, self.swarm or found.swarm, self.insecure or found.insecure)

    def report(self) -> Path | None:
        """Return the run's report, when it has been written and is on this machine."""
        if self.folder is None or not (path := self.folder / REPORT_FILE).is_file():
            return None
        return path
