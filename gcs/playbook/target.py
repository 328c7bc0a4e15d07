"""What a playbook is flown on: the same one flies on simulated vehicles and on the ones it names."""

from __future__ import annotations

from typing import Final

from pydantic import ValidationError

from gcs.errors import ServiceError
from gcs.playbook.schema import LONGEST_PATIENCE_S, Playbook, Target

STALL_S: Final = 1.5
"""For so long by its own clock this machine may be busy with something else."""


def aimed(playbook: Playbook, target: Target | None = None) -> Playbook:
    """Return the playbook as flown on a target, its own unless another is given; it names vehicles only for them.

    ServiceError when it cannot be flown there.
    """
    chosen = target or playbook.target or ("embedded" if playbook.vehicles is None else "vehicles")
    changed = {"target": chosen, "vehicles": playbook.vehicles if chosen == "vehicles" else None}
    try:
        return Playbook.model_validate(playbook.model_copy(update=changed).model_dump(mode="json"))
    except ValidationError as error:
        reasons = "; ".join(f"{'.'.join(map(str, details['loc']))}: {details['msg']}" for details in error.errors())
        raise ServiceError(f"{playbook.name} cannot be flown on {chosen}: {reasons}") from error


def patient(playbook: Playbook, speedup: float) -> Playbook:
    """Return the playbook with a `give_up_s` that outlasts what a busy machine makes wait.

    That is no fault of the swarm, and costs `speedup` times as long in simulated time. Velocities are zero meanwhile as
    always.
    """
    patience_s = min(LONGEST_PATIENCE_S, max(playbook.flight.give_up_s, STALL_S * speedup))
    return playbook.model_copy(update={"flight": playbook.flight.model_copy(update={"give_up_s": patience_s})})
