"""The state of a run that screens show: one object, written by the service and only read elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.clock import Clock
from gcs.relay.records import ReceiverRecord

_MESSAGES_KEPT = 200


@dataclass
class RunStatus:
    """What is going on in a run."""

    playbook: str
    clock: Clock
    phase: str = "starting"
    started_s: float = 0.0
    records: Mapping[str, ReceiverRecord] = field(default_factory=dict)
    on_air: frozenset[str] = frozenset()
    messages: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=_MESSAGES_KEPT))

    def __post_init__(self) -> None:
        self.started_s = self.clock.now_s()

    def elapsed_s(self) -> float:
        """Return the time since the run began, s."""
        return self.clock.now_s() - self.started_s

    def say(self, message: str) -> None:
        """Add a message for the operator."""
        self.messages.append((self.elapsed_s(), message))
