"""A flight with a copter that acknowledges everything and does nothing: the test says what its telemetry shows."""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.fakes import settle


class ScriptedCopter:
    """Acknowledges every command with ACCEPTED unless told otherwise; the test says what its telemetry shows."""

    def __init__(self, rig):
        self.speaker = rig.copter
        self.results = {}
        self.reasons = {}
        self.mute = set()
        rig.wire.on_send = self._obey

    def _obey(self, message):
        if message.get_type() == "COMMAND_LONG":
            asyncio.get_running_loop().call_soon(self._answer, message.command)

    def _answer(self, command):
        if command in self.reasons:
            self.speaker.text(self.reasons[command])
        if command not in self.mute:
            self.speaker.acknowledge(command, self.results.get(command, mavlink.MAV_RESULT_ACCEPTED))


class Flight:
    def __init__(self, rig, autopilot, altitude_m):
        self.rig, self.clock, self.wire = rig, rig.clock, rig.wire
        self.copter = ScriptedCopter(rig)
        self.says = rig.copter
        self.vehicle = rig.vehicle()
        self.autopilot = autopilot
        self.altitude_m = altitude_m
        self._tasks = []

    @property
    def commands(self):
        return [message.command for message in self.wire.commands]

    async def start(self, coroutine):
        self._tasks.append(asyncio.create_task(coroutine))
        await settle()
        return self._tasks[-1]

    async def take_off(self):
        return await self.start(self.autopilot.take_off(self.vehicle, self.altitude_m))

    async def close(self):
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
