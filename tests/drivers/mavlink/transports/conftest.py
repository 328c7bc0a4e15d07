"""What every transport is tested with: frames of a vehicle, and somebody who keeps what is heard."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.codec import Codec

HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
PATIENCE_S = 5.0


class Ears:
    """Takes frames in, and refuses those of the systems it is told to."""

    def __init__(self):
        self.refused_system_ids = set()
        self._frames = asyncio.Queue()

    def __call__(self, frame):
        if frame[5] in self.refused_system_ids:
            return False
        self._frames.put_nowait(frame)
        return True

    async def next(self):
        return await asyncio.wait_for(self._frames.get(), PATIENCE_S)

    @property
    def empty(self):
        return self._frames.empty()


@pytest.fixture
def ears():
    return Ears()


@pytest.fixture
def frames():
    codec = Codec(1, 1)
    return [bytearray(codec.encode(HEARTBEAT)) for _ in range(6)]


@pytest.fixture
def frame_by():
    """How to make a frame of any message by any sender."""

    def frame(message=HEARTBEAT, system_id=1, component_id=1):
        return bytearray(Codec(system_id, component_id).encode(message))

    return frame
