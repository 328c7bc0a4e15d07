"""The state of a run that screens show: one object, written by the service and only read elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Protocol

from drivers.bus.run_messages import Level
from drivers.clock import Clock
from drivers.mavlink.link_status import LinkStatus
from gcs.relay.records import ReceiverRecord

_MESSAGES_KEPT = 200


class RelayView(Protocol):
    """What screens ask of a relay as a whole."""

    @property
    def held(self) -> str | None:
        """Why nobody flies until the operator resumes, or None."""
        ...

    @property
    def waiting(self) -> bool:
        """Whether the relay waits for the operator's word."""
        ...

    @property
    def taken(self) -> AbstractSet[str]:
        """The vehicles that are their pilots'."""
        ...

    def ways_out(self) -> list[str]:
        """Return the commands that would change something."""
        ...


@dataclass(frozen=True)
class Said:
    """A message for the operator, and what it is about where it is about one vehicle."""

    elapsed_s: float
    text: str
    level: Level = "info"
    vehicle: str | None = None
    leg: int | None = None
    state: str | None = None
    """The state the vehicle came into."""


@dataclass
class RunStatus:
    """What is going on in a run."""

    playbook: str
    clock: Clock
    phase: str = "starting"
    started_s: float = 0.0
    records: Mapping[str, ReceiverRecord] = field(default_factory=dict)
    on_air: frozenset[str] = frozenset()
    relay: RelayView | None = None
    """The relay, once it is being flown."""
    asked: str | None = None
    """What the operator is asked, while nothing goes on without his word."""
    links: Callable[[], Sequence[tuple[str, LinkStatus]]] = tuple
    """Tells how the links fare, each with the names of the vehicles behind it."""
    recording: Callable[[], str | None] = lambda: None
    """Tells what is wrong with the recording of the links, or None."""
    refused_on_bus: Callable[[], str | None] = lambda: None
    """Tells what the bus routers refused, or None."""
    messages: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=_MESSAGES_KEPT))
    said: int = 0
    """How many messages there have been; the last of them are kept."""
    on_said: list[Callable[[Said], None]] = field(default_factory=list)
    """Get every message as it is said; they must not raise."""

    def __post_init__(self) -> None:
        self.started_s = self.clock.now_s()

    def elapsed_s(self) -> float:
        """Return the time since the run began, s."""
        return self.clock.now_s() - self.started_s

    def ask(self, question: str | None) -> None:
        """Put a question before the operator, or take it back."""
        self.asked = question

    def say(
        self,
        message: str,
        *,
        level: Level = "info",
        vehicle: str | None = None,
        leg: int | None = None,
        state: str | None = None,
    ) -> None:
        """Add a message for the operator; of one about a vehicle, say which, its leg, and the state it came into."""
        said = Said(self.elapsed_s(), message, level, vehicle, leg, state)
        self.messages.append((said.elapsed_s, message))
        self.said += 1
        for listener in self.on_said:
            listener(said)
