"""The folder of one run: runs/<time>-<playbook>/."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gcs.errors import ServiceError


@dataclass(frozen=True)
class RunFolder:
    """Where everything of one run is written."""

    path: Path

    @classmethod
    def create(cls, runs_dir: Path, playbook_name: str, now: datetime | None = None) -> RunFolder:
        """Make a new folder under `runs_dir`. ServiceError when it cannot be made."""
        stamp = (now or datetime.now(UTC)).strftime("%Y%m%dT%H%M%S")
        try:
            for attempt in range(1000):
                path = runs_dir / (f"{stamp}-{playbook_name}" + (f"-{attempt}" if attempt else ""))
                try:
                    path.mkdir(parents=True)
                except FileExistsError:
                    continue
                (path / "logs").mkdir()
                return cls(path)
        except OSError as error:
            raise ServiceError(f"the run folder cannot be made under {runs_dir}: {error}. Choose --runs-dir") from error
        raise ServiceError(f"{runs_dir} already holds 1000 runs of this second: choose another --runs-dir")

    @property
    def logs(self) -> Path:
        """Where the simulated processes write their output."""
        return self.path / "logs"

    def write_json(self, name: str, data: Any) -> Path:
        """Write a JSON document into the folder and return its path, as `replace_json`."""
        return replace_json(self.path / name, data)


def replace_json(path: Path, data: Any) -> Path:
    """Write a JSON document whole, or leave the one before as it is: ServiceError when it cannot be written."""
    new = path.with_name(f".{path.name}.new")
    try:
        write_json(new, data)
        new.replace(path)
    except (ServiceError, OSError) as error:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise ServiceError(f"{path} cannot be written: {error.__cause__ or error}") from error
    return path


def write_json(path: Path, data: Any) -> Path:
    """Write a JSON document; ServiceError when it cannot be written. NaN and infinity are refused."""
    try:
        path.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise ServiceError(f"{path} cannot be written: {error}") from error
    return path
