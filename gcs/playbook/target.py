"""What a playbook is flown on: the same one flies on simulated vehicles and on the ones it names."""

from __future__ import annotations

from pydantic import ValidationError

from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook, Target


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
