"""Whatever the operator, the pilots and the sensors do, in any order: nobody's vehicle is flown against him."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import cache
from itertools import pairwise

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from drivers.bus.messages import ControlReply
from drivers.mavlink.setpoints import StreamState
from gcs.relay.states import IN_FLIGHT, TRANSITIONS, ReceiverState
from planner.methods import METHODS
from planner.plan import RelayPlan
from tests.gcs.relay.operating import speak, step
from tests.gcs.relay.world import PERIOD_S, World

FLYING = (ReceiverState.LEG_1, ReceiverState.LEG_2, ReceiverState.TRIMMING)
UAVS = ["L0", "L1", *(f"U{k}" for k in range(1, 9))]
uavs = st.sampled_from(UAVS)


@cache
def plan_of(objective: str) -> RelayPlan:
    """The paper's eight, one after another or several at once."""
    return METHODS["joint"](replace(World().playbook.problem(), objective=objective))


class Operation(RuleBasedStateMachine):
    """A relay that is flown while the rules happen to it."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = asyncio.Runner()
        self.taken: dict[str, int] = {}  # how often each pilot's vehicle had been flown when he took it

    @initialize(objective=st.sampled_from(["length", "balanced"]), attended=st.sampled_from([True, True, True, False]))
    def start(self, objective: str, attended: bool) -> None:
        self.world = World(sigma_deg=0.1, plan=plan_of(objective), attended=attended)
        self.executor = self.world.executor
        self.loop.run(self._start())

    async def _start(self) -> None:
        self.relay = asyncio.create_task(self.executor.run())
        await step(self.world)

    @rule(duration_s=st.sampled_from([PERIOD_S, 1.0, 5.0, 20.0]))
    def wait(self, duration_s: float) -> None:
        for _ in range(round(duration_s / PERIOD_S)):
            self.loop.run(step(self.world))
            self.nobody_is_flown_against_his_pilot()

    @rule(words=st.sampled_from(["hold", "resume", "resume"]))
    def say(self, words: str) -> None:
        self.loop.run(self._say(words))

    @rule(verb=st.sampled_from(["skip", "release", "release"]), name=uavs)
    def say_of(self, verb: str, name: str) -> None:
        before = self.world.states().get(name)
        reply = self.loop.run(self._say(f"{verb} {name}"))
        if reply.ok and verb == "release":
            self.taken.pop(name, None)
            if before is ReceiverState.PILOT:
                assert self.world.states()[name] is ReceiverState.HELD

    async def _say(self, words: str) -> ControlReply:
        return speak(self.world, words)

    @rule(duration_s=st.sampled_from([5.0, 20.0, 40.0]))
    def put_right(self, duration_s: float) -> None:
        """Repair everything, release everybody, resume: whoever is not in his slot flies, or nobody is left."""
        self.world.silenced.clear()
        self.world.objections.clear()
        for name, vehicle in self.world.vehicles.items():
            vehicle.guided = True
            self.say_of("release", name)
        assert self.executor.ended or not self.executor.taken
        self.loop.run(self._say("resume"))
        assert self.executor.held is None or self.executor.ended
        self.wait(PERIOD_S)
        states = set(self.world.states().values())
        assert self.executor.ended or IN_FLIGHT & states or self.executor.held
        self.wait(duration_s)

    @rule(name=uavs, moved=st.sampled_from([0j, 3 - 4j, -30 + 20j]))
    def take_over(self, name: str, moved: complex) -> None:
        vehicle = self.world.vehicles[name]
        self.taken.setdefault(name, len(vehicle.renewals))
        vehicle.take_over()
        vehicle.place += moved

    @rule(name=uavs)
    def back_to_guided(self, name: str) -> None:
        self.world.vehicles[name].guided = True

    @rule(name=st.sampled_from(UAVS[2:]), silent=st.booleans())
    def silence(self, name: str, silent: bool) -> None:
        (self.world.silenced.add if silent else self.world.silenced.discard)(name)

    @rule(name=uavs, problem=st.sampled_from([None, None, "only 2.0 m from U5"]))
    def safety(self, name: str, problem: str | None) -> None:
        self.world.objections.pop(name, None)
        if problem is not None:
            self.world.objections[name] = problem

    @invariant()
    def nobody_is_flown_against_his_pilot(self) -> None:
        for name, flown in self.taken.items():
            assert self.world.vehicles[name].state is StreamState.PILOT
            assert len(self.world.vehicles[name].renewals) == flown

    @invariant()
    def every_transition_stands_in_the_table(self) -> None:
        for name, record in self.executor.records.items():
            changes = [ReceiverState.WAITING, *(state for _, at, state, _ in self.world.history if at == name)]
            for old, new in pairwise(changes):
                assert new is old or new in TRANSITIONS[old], f"{name}: {old} -> {new}"
            assert changes[-1] is record.state

    @invariant()
    def the_relay_has_not_failed(self) -> None:
        if self.relay.done():
            self.relay.result()
            assert self.executor.ended

    @invariant()
    def held_means_that_nobody_flies(self) -> None:
        states = self.world.states()
        if self.executor.held is not None:
            assert not IN_FLIGHT & set(states.values())
        for name, vehicle in self.world.vehicles.items():
            assert not vehicle.command or states[name] in FLYING

    @invariant()
    def only_who_stands_is_trusted(self) -> None:
        states = self.world.states()
        for name in self.executor.standing.places:
            assert name not in self.executor.taken
            assert states.get(name, ReceiverState.PLACED) is ReceiverState.PLACED

    def teardown(self) -> None:
        if hasattr(self, "relay"):
            self.loop.run(self._say("abort"))
            self.loop.run(self._finish())
        self.loop.close()

    async def _finish(self) -> None:
        """Aborted, it ends at once, with nobody flying and nobody on the air."""
        for _ in range(10):
            await step(self.world)
        self.relay.result()
        assert not any(vehicle.command for vehicle in self.world.vehicles.values())
        assert not self.world.on_air


TestOperation = Operation.TestCase
TestOperation.settings = settings(max_examples=12, stateful_step_count=30, deadline=None)
