"""Where the bus of a run is: `bus.json` in its folder, for whoever wants to have a word with the relay."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from drivers.strict_json import read_json
from gcs.errors import ServiceError

FILE: Final = "bus.json"


class BusAddress(msgspec.Struct, frozen=True):
    """The endpoint of a run's bus router, and its swarm."""

    endpoint: str
    swarm: str
    insecure: bool = False
    """Whether the run says that strangers may join its bus."""


def address_of(run: Path) -> BusAddress:
    """Return the address in a run's folder. ServiceError when there is none that can be read."""
    path = run / FILE
    try:
        return read_json(path.read_bytes(), BusAddress)
    except OSError as error:
        raise ServiceError(f"{path} cannot be read: {error}. Name the run with --run, or give --connect") from error
    except msgspec.MsgspecError as error:
        raise ServiceError(f"{path} is no address of a bus: {error}. Give --connect and --swarm") from error


def newest_run(runs_dir: Path) -> Path:
    """Return the run folder whose bus was opened last. ServiceError when there is none."""
    opened = sorted(runs_dir.glob(f"*/{FILE}"), key=lambda path: (path.stat().st_mtime_ns, path))
    if not opened:
        raise ServiceError(f"no run in {runs_dir} has a bus: name a run with --run, or give --connect and --swarm")
    return opened[-1].parent
