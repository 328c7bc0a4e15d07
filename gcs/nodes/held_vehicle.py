"""One vehicle that a node holds: its link, its setpoint stream and the leg it flies, as far as it is the node's."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import DriverError, VehicleError
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.codec import Codec
from drivers.mavlink.setpoints import SetpointStreamer, StreamLimits, StreamState
from drivers.mavlink.vehicle import Vehicle
from gcs.bearings import BearingFeed
from gcs.clock_offsets import ClockOffsets
from gcs.nodes.held_leg import GrantedLease, HeldLeg, HeldMonitor
from gcs.nodes.messages import (
    Adopt,
    Assign,
    BringUp,
    Command,
    Done,
    FlyLeg,
    HeldVehicle,
    Post,
    Refused,
    Release,
    Report,
)
from gcs.nodes.tenure import Tenure
from gcs.nodes.wires import Wires
from gcs.takeovers import Takeovers
from planner.frames import FormationFrame

HEARTBEAT_TIMEOUT_S: Final = 5.0
RETRY_S: Final = 1.0
"""After so long a link that could not be opened is tried again."""

PASSED_ON: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
    }
)
"""What of the service's own frames reaches a vehicle: commands and questions. Setpoints come from here alone."""
FOR_ALL: Final = frozenset({mavlink.MAVLINK_MSG_ID_TIMESYNC})
"""What of that may name no vehicle: everybody behind the link answers it, and nobody does anything."""


@dataclass
class Holder:
    """One vehicle at its node. `report` sends what is told of it; whatever of it takes time runs as its `task`."""

    name: str
    post: Post
    assign: Assign
    tenure: Tenure
    wires: Wires
    clock: Clock
    report: Callable[[Report], None]
    takeovers: Takeovers
    vehicle: Vehicle | None = field(default=None, init=False)
    opening: bool = field(default=False, init=False)
    problem: str = field(default="", init=False)
    order: int = field(default=0, init=False)
    """The last order that came."""
    feed: BearingFeed = field(init=False)
    clocks: ClockOffsets = field(init=False)
    _stream: SetpointStreamer | None = field(default=None, init=False)
    _autopilot: Autopilot | None = field(default=None, init=False)
    _streaming: asyncio.Task[None] | None = field(default=None, init=False)
    _asking: asyncio.Task[None] | None = field(default=None, init=False)
    _task: asyncio.Task[None] | None = field(default=None, init=False)
    _flying: FlyLeg | None = field(default=None, init=False)
    _monitor: HeldMonitor | None = field(default=None, init=False)
    _codec: Codec = field(default_factory=Codec, init=False)

    def __post_init__(self) -> None:
        frame = FormationFrame(self.assign.axis_azimuth_rad)
        self.clocks = ClockOffsets([self.name], self.clock)
        self.feed = BearingFeed([self.name], frame, self.clock, self.assign.gap_s, self.clocks, self.assign.reference)

    def beat(self) -> HeldVehicle:
        """Return what a beat says of it."""
        held = self.tenure.holdings.get(self.name)
        return HeldVehicle(
            token=self.post.token,
            open=self.vehicle is not None,
            state=None if self._stream is None else self._stream.state,
            stops=0 if held is None else held.granted.stops,
            order=self.order,
            to_pilot=self.takeovers.setpoints_after(self.name),
            problem=self.problem,
        )

    async def open(self) -> None:
        """Open its link; what keeps it closed is its problem."""
        try:
            self.vehicle, self.problem = await self.wires.open(self.name, self.post, self.assign.station_id), ""
            self._asking = asyncio.ensure_future(self.clocks.run())
        except DriverError as error:
            self.problem = str(error)
            await self.clock.sleep(RETRY_S)
        finally:
            self.opening = False

    def take(self, order: BringUp | Adopt | Release | FlyLeg | Command) -> None:
        """Carry out an order, which the tenure obeys. One that came before is not done again."""
        if isinstance(order, Command):
            self._pass_on(order)
            return
        if order.order <= self.order:
            return
        self.order = order.order
        if isinstance(order, FlyLeg):
            self._take_leg(order)
        elif isinstance(order, Release):
            self._release(order)
        else:
            self._begin(self._guide(order))

    def stop(self, stops: int) -> None:
        """Stop it by the service's word, and end the leg that was begun before that."""
        if self._flying is not None and self._flying.stops >= stops:
            return
        self._end_task()
        if self._stream is not None:
            self._stream.stop()

    def lapse(self) -> None:
        """Stop it: its grant has run out. Where guided flight needs a stream, it is left in a hold of its own."""
        if self._stream is None or self._autopilot is None or self.vehicle is None:
            return
        self._stream.stop()
        if self._autopilot.stream.idle_setpoint is not None and self._stream.state is not StreamState.PILOT:
            self._autopilot.hold(self.vehicle)

    async def close(self) -> None:
        """Let it go: nothing is sent to it any more."""
        self._end_task()
        for task in filter(None, (self._streaming, self._asking)):
            task.cancel()
        await self.wires.close(self.name)
        self.vehicle = self._stream = None

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        self._end_task()
        self._task = asyncio.ensure_future(work)

    def _end_task(self) -> None:
        self._flying = None
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _guide(self, order: BringUp | Adopt) -> None:
        """Bring it into guided flight, or take it as it flies, and stream to it from then on."""
        try:
            await self._streamed(order)
        except DriverError as error:
            problem = error.problem if isinstance(error, VehicleError) else str(error)
            way_out = error.way_out if isinstance(error, VehicleError) else ""
            self._done(order, problem, way_out)
        else:
            self._done(order)

    async def _streamed(self, order: BringUp | Adopt) -> None:
        vehicle = self._opened()
        await vehicle.wait_until(
            lambda: vehicle.telemetry.heartbeat is not None,
            HEARTBEAT_TIMEOUT_S,
            f"heartbeat of system id {vehicle.system_id}",
            "Check the link's address and system id, and that it can be reached from its node.",
        )
        self._autopilot = autopilot = autopilot_of(vehicle, self.post.autopilot)
        if isinstance(order, BringUp):
            await autopilot.take_off(vehicle, self.post.altitude_m)
        limits = StreamLimits(lease_s=self.post.lease_s, largest_speed_mps=self.post.speed_mps)
        if self._streaming is not None:
            self._streaming.cancel()
        self._stream = SetpointStreamer(vehicle, autopilot, self.post.altitude_m, limits, self.clock)
        self.takeovers.watch(vehicle, autopilot.is_guided)
        if isinstance(order, Adopt) and order.withheld:
            self._stream.state = StreamState.PILOT
        self._streaming = asyncio.ensure_future(self._stream.run())

    def _release(self, order: Release) -> None:
        problem = "it has no stream yet" if self._stream is None else self._stream.release()
        self._done(order, problem or "")

    def _take_leg(self, order: FlyLeg) -> None:
        held = self.tenure.holdings[self.name]
        if order.stops < held.granted.stops:
            self._refuse(order, "it was told to stop since")
            return
        if self._stream is None or self.vehicle is None:
            self._refuse(order, "it is not in guided flight")
            return
        lease = GrantedLease(self.name, self._stream, self.tenure, self.clock)
        frame = FormationFrame(self.assign.axis_azimuth_rad)
        leg = HeldLeg(order, lease, self.feed, frame, self.report)
        self._monitor = leg.monitor(self._monitor)
        if self._monitor is None:
            self._refuse(order, "the leg before was not flown here")
            return
        self._begin(leg.fly(self._monitor, self.vehicle.silent_for_s))
        self._flying = order

    def _pass_on(self, order: Command) -> None:
        message = self._codec.decode(bytearray(order.frame))
        if message is None:
            self._refuse(order, "it is no MAVLink 2 frame")
        elif message.get_msgId() not in PASSED_ON:
            self._refuse(order, "it is no command")
        elif (target := getattr(message, "target_system", 0)) == 0 and message.get_msgId() not in FOR_ALL:
            self._refuse(order, "it is for every system behind the link: a command names its vehicle")
        elif target not in (0, self.post.system_id):
            self._refuse(order, "it is for another system")
        elif self.vehicle is not None and order.urgent:
            self.vehicle.link.drop_setpoint(self.post.system_id)
            self.vehicle.link.post_urgent(message)
        elif self.vehicle is not None:
            self.vehicle.link.post(message)

    def _opened(self) -> Vehicle:
        if self.vehicle is None:
            raise VehicleError(self.name, self.post.link, "its link is not open", self.problem)
        return self.vehicle

    def _done(self, order: BringUp | Adopt | Release, problem: str = "", way_out: str = "") -> None:
        state = None if self._stream is None else self._stream.state
        self.report(Done(order.vehicle, order.token, order.order, state, problem, way_out))

    def _refuse(self, order: FlyLeg | Command, why: str) -> None:
        self.tenure.refused[why] += 1
        self.report(Refused(order.vehicle, order.token, order.order, why))
