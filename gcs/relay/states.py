"""The states of a receiver in the relay, and the one table of transitions between them."""

from __future__ import annotations

from enum import Enum
from types import MappingProxyType
from typing import Final

from gcs.errors import IllegalTransitionError


class ReceiverState(Enum):
    """Where a receiver stands in the relay."""

    WAITING = "WAITING"
    LOCATING = "LOCATING"
    LEG_1 = "LEG_1"
    LEG_2 = "LEG_2"
    VERIFYING = "VERIFYING"
    TRIMMING = "TRIMMING"
    PLACED = "PLACED"
    HELD = "HELD"
    PILOT = "PILOT"
    FAILED = "FAILED"


_S = ReceiverState
_EXITS: Final = frozenset({_S.HELD, _S.PILOT, _S.FAILED})

# A route has two legs, one where guide, start and slot lie in line, none where the receiver stands in its slot; a trim
# leg follows where bearings put it off its slot then.
# Whoever was held is located anew before anything else, and a pilot's vehicle is held before it flies again.
TRANSITIONS: Final = MappingProxyType(
    {
        _S.WAITING: frozenset({_S.LOCATING}) | _EXITS,
        _S.LOCATING: frozenset({_S.LEG_1, _S.VERIFYING}) | _EXITS,
        _S.LEG_1: frozenset({_S.LEG_2, _S.VERIFYING}) | _EXITS,
        _S.LEG_2: frozenset({_S.VERIFYING}) | _EXITS,
        _S.VERIFYING: frozenset({_S.TRIMMING, _S.PLACED}) | _EXITS,
        _S.TRIMMING: frozenset({_S.VERIFYING}) | _EXITS,
        _S.PLACED: _EXITS,
        _S.HELD: frozenset({_S.LOCATING, _S.PILOT, _S.FAILED}),
        _S.PILOT: frozenset({_S.HELD, _S.FAILED}),
        _S.FAILED: frozenset(),
    }
)

IN_FLIGHT: Final = frozenset({_S.LOCATING, _S.LEG_1, _S.LEG_2, _S.VERIFYING, _S.TRIMMING})
"""States in which the executor works on the receiver."""

ENDED: Final = frozenset({_S.PLACED, _S.FAILED})
"""States in which nothing more is done for the receiver, unless a pilot takes it."""


HALTED: Final = frozenset({_S.HELD, _S.PILOT, _S.FAILED})
"""States in which a receiver does not fly, and somebody should know."""


def require_transition(receiver: str, old: ReceiverState, new: ReceiverState) -> None:
    """Return when the table allows the transition; IllegalTransitionError naming both states when not."""
    if new not in TRANSITIONS[old]:
        raise IllegalTransitionError(
            f"{receiver}: {old.value} -> {new.value} is not a transition of the relay; "
            f"from {old.value} it may go to {', '.join(sorted(state.value for state in TRANSITIONS[old])) or 'nowhere'}"
        )
