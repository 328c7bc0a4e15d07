"""An operator in the world of virtual time: he speaks as over the bus, when something holds."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.bus.messages import ControlReply, ControlRequest, decode, encode
from gcs.control import ControlDesk
from gcs.relay.states import ReceiverState
from tests.gcs.relay.world import PERIOD_S, World

Step = tuple[Callable[[], bool], Callable[[], object]]


def speak(world: World, words: str) -> ControlReply:
    """Say `words`, such as "release U1", and return the answer."""
    verb, *vehicle = words.split()
    payload = encode(ControlRequest(verb=verb, vehicle=vehicle[0] if vehicle else None))
    return decode(ControlDesk(world.executor, world.said.append).answer(payload), ControlReply)


def done(world: World, words: str) -> str:
    """Say `words`, which must be done, and return the message."""
    reply = speak(world, words)
    assert reply.ok, reply.message
    return reply.message


def refused(world: World, words: str) -> str:
    """Say `words`, which must be refused, and return the message."""
    reply = speak(world, words)
    assert not reply.ok, reply.message
    return reply.message


class Script:
    """Does each step as soon as its condition holds, one after the other."""

    def __init__(self, steps: Iterable[Step]) -> None:
        self.left = list(steps)

    def __call__(self, _: float) -> None:
        if self.left and self.left[0][0]():
            self.left.pop(0)[1]()


def in_turn(*steps: Step) -> Script:
    """Return what does each step as soon as its condition holds; World.run fails when some are left."""
    return Script(steps)


def after(world: World, duration_s: float) -> Callable[[], bool]:
    """Return the condition that so much time has passed since it was first asked for."""
    asked: list[float] = []

    def passed() -> bool:
        asked.append(world.clock.now_s())
        return asked[-1] - asked[0] >= duration_s

    return passed


def reached(world: World, name: str, state: ReceiverState, for_s: float = 0.0) -> Callable[[], bool]:
    """Return the condition that a receiver has been in a state for a while."""
    since: list[float] = []

    def holds() -> bool:
        if world.states()[name] is not state:
            since.clear()
            return False
        since.append(world.clock.now_s())
        return since[-1] - since[0] >= for_s

    return holds


async def step(world: World) -> None:
    """Let a moment pass in a world whose relay is run by the test itself."""
    world._measure()
    await world.clock.advance(PERIOD_S)
    for vehicle in world.vehicles.values():
        vehicle.move(PERIOD_S)
