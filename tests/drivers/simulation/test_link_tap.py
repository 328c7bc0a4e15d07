"""The tap on a simulated vehicle's link: transparent, until it is cut or fails; and others may speak through it."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterator

from drivers.simulation.impairment import UNIMPAIRED, Impairment
from drivers.simulation.link_tap import AGAIN_S, HOST, open_tap
from tests.fakes import ManualClock


@contextlib.contextmanager
def opened() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind((HOST, 0))
        end.settimeout(0.0)
        yield end


async def heard(end: socket.socket) -> bytes | None:
    """The next datagram, or None when none comes."""
    with contextlib.suppress(TimeoutError):
        return await asyncio.wait_for(asyncio.get_running_loop().sock_recv(end, 100), 0.2)
    return None


async def test_both_sides_hear_each_other_until_the_link_is_cut_and_again_afterwards() -> None:
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1]) as tap:
            there = (HOST, tap.port)
            vehicle.sendto(b"telemetry", there)
            assert await heard(service) == b"telemetry"
            service.sendto(b"command", there)
            assert await heard(vehicle) == b"command"
            tap.cut = True
            vehicle.sendto(b"lost", there)
            service.sendto(b"lost", there)
            assert (await heard(service), await heard(vehicle)) == (None, None)
            tap.cut = False
            vehicle.sendto(b"again", there)
            assert await heard(service) == b"again"


async def test_another_station_is_heard_by_the_vehicle_alone_cut_or_not() -> None:
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1]) as tap:
            tap.speak(b"to nobody yet")
            vehicle.sendto(b"telemetry", (HOST, tap.port))
            assert await heard(service) == b"telemetry"
            tap.cut = True
            tap.speak(b"pilot")
            assert await heard(vehicle) == b"pilot"
            assert await heard(service) is None


async def test_a_mute_vehicle_is_spoken_to_and_not_heard_until_it_is_again() -> None:
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1]) as tap:
            there = (HOST, tap.port)
            vehicle.sendto(b"telemetry", there)
            assert await heard(service) == b"telemetry"
            tap.mute = True
            vehicle.sendto(b"lost", there)
            service.sendto(b"command", there)
            assert await heard(vehicle) == b"command"
            assert await heard(service) is None
            tap.mute = False
            vehicle.sendto(b"again", there)
            assert await heard(service) == b"again"


async def test_another_station_says_the_same_again_and_again_until_it_is_told_otherwise() -> None:
    clock = ManualClock()
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1], clock) as tap:
            vehicle.sendto(b"telemetry", (HOST, tap.port))
            assert await heard(service) == b"telemetry"
            tap.keep_saying(b"go")
            await clock.advance(2 * AGAIN_S)
            assert [await heard(vehicle) for _ in range(4)] == [b"go", b"go", b"go", None]
            tap.keep_saying(b"come")
            await clock.advance(0.0)
            tap.keep_saying(None)
            await clock.advance(5 * AGAIN_S)
            assert [await heard(vehicle) for _ in range(2)] == [b"come", None]


async def test_a_bad_link_loses_doubles_and_delays_either_way_until_it_is_good_again() -> None:
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1], seed="1") as tap:
            there = (HOST, tap.port)
            tap.impairment = Impairment(loss=1.0)
            vehicle.sendto(b"lost", there)
            assert await heard(service) is None
            tap.impairment = Impairment(duplication=1.0)
            vehicle.sendto(b"twice", there)
            service.settimeout(5.0)
            assert [await asyncio.to_thread(service.recv, 100) for _ in range(2)] == [b"twice", b"twice"]
            service.settimeout(0.0)
            tap.impairment = Impairment(delay_s=0.1)
            service.sendto(b"late", there)
            tap.impairment = UNIMPAIRED
            assert await heard(vehicle) == b"late"
            vehicle.sendto(b"again", there)
            assert await heard(service) == b"again"


async def test_what_is_under_way_when_the_link_is_cut_is_lost() -> None:
    with opened() as service, opened() as vehicle:
        async with open_tap(3, service.getsockname()[1]) as tap:
            tap.impairment = Impairment(delay_s=0.05)
            vehicle.sendto(b"late", (HOST, tap.port))
            await asyncio.sleep(0.02)
            tap.cut = True
            assert await heard(service) is None
