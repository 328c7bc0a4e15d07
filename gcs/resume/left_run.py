"""The folder of a run that is to go on: what was flown, by which plan, since when."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from pathlib import Path

from drivers.strict_json import MalformedError, read_any_json, read_json
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.recording.facts import FILE as FACTS_FILE
from gcs.recording.facts import RunFacts
from planner.plan import RelayPlan, plan_from_json


@dataclass(frozen=True)
class LeftRun:
    """A run as its service left it."""

    folder: Path
    playbook: Playbook
    plan: RelayPlan
    facts: RunFacts

    def new_logs(self) -> Path:
        """Make a folder for the logs of the service that goes on, and return it. ServiceError when that cannot be."""
        for number in count(1):
            path = self.folder / "logs" / f"resumed-{number}"
            try:
                path.mkdir(parents=True)
            except FileExistsError:
                continue
            except OSError as error:
                raise ServiceError(f"{path} cannot be made: {error}") from error
            break
        return path


def read_left_run(folder: Path) -> LeftRun:
    """Return the run in a folder. ServiceError when it holds none that can go on."""
    try:
        playbook = Playbook.model_validate(read_any_json((folder / "playbook.json").read_bytes()))
        plan = plan_from_json(read_any_json((folder / "plan.json").read_bytes()))
        facts = read_json((folder / FACTS_FILE).read_bytes(), RunFacts)
    except OSError as error:
        raise ServiceError(f"{folder} is no run that can go on: {error}") from error
    except (MalformedError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        raise ServiceError(f"{folder} is no run that can go on, its files cannot be read: {error}") from error
    if playbook.vehicles is None:
        raise ServiceError(
            f"{folder}: its vehicles were simulated by the service, and have ended with it. Fly its playbook anew"
        )
    return LeftRun(folder, playbook, plan, facts)
