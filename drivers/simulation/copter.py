"""A simulated ArduCopter as a process of its own: `python -m drivers.simulation.copter --help`."""

from __future__ import annotations

import argparse
import asyncio
import gc
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from math import isfinite, radians
from typing import NoReturn

from drivers.clock import SystemClock
from drivers.simulation.autopilot import Autopilot
from drivers.simulation.geodesy import GeoPoint
from drivers.simulation.links import LinkAddress, UdpLink
from drivers.simulation.parameters import Parameters
from drivers.simulation.pump import Pump

PARENT_POLL_S = 0.5


def main(argv: Sequence[str]) -> int:
    """Fly one copter until SIGTERM, SIGINT or the parent's end; return the exit status."""
    options = _arguments(argv)
    try:
        asyncio.run(_fly(options))
    except OSError as error:
        sys.stderr.write(f"{options.name}: cannot open a link: {error}\n")
        return 1
    return 0


async def _fly(options: argparse.Namespace) -> None:
    clock = SystemClock(options.speedup, options.epoch_ns)
    autopilot = _switched_on(options, clock)
    stopped = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    with ExitStack() as opened:
        links = [opened.enter_context(closing(UdpLink(address))) for address in options.link]
        gc.collect()
        gc.freeze()
        pump = Pump(autopilot, links, clock)
        pump.start()
        opened.callback(pump.stop)
        async with asyncio.TaskGroup() as tasks:
            watch = tasks.create_task(_watch_parent(options.parent_pid, stopped))
            await stopped.wait()
            watch.cancel()


def _switched_on(options: argparse.Namespace, clock: SystemClock) -> Autopilot:
    parameters = Parameters()
    for name, value in [*options.param, ("SYSID_THISMAV", options.system_id)]:
        parameters.set(name, value)
    origin, heading_rad = options.home
    return Autopilot(
        options.name,
        origin,
        parameters,
        heading_rad=heading_rad,
        ready_s=options.ready_after,
        boot_unix_ns=clock.unix_ns(),
        seed=options.seed,
    )


async def _watch_parent(pid: int | None, stopped: asyncio.Event) -> None:
    """Set `stopped` once the process `pid` is gone."""
    if pid is None:
        return
    direct = os.getppid() == pid
    while os.getppid() == pid if direct else _exists(pid):  # noqa: ASYNC110 - no event tells of it everywhere
        await asyncio.sleep(PARENT_POLL_S)
    stopped.set()


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = _OneLineParser(prog="copter", description="Fly a simulated ArduCopter that speaks MAVLink 2 over UDP.")
    parser.add_argument("--name", required=True, help="what to call it in errors; also makes its unique id")
    parser.add_argument("--system-id", required=True, type=_system_id, help="MAVLink system id, 1 to 255")
    parser.add_argument(
        "--link",
        required=True,
        action="append",
        type=_link,
        metavar="ADDRESS",
        help="udpout:HOST:PORT or udpin:HOST:PORT; may be given more than once",
    )
    parser.add_argument(
        "--home", required=True, type=_home, metavar="LAT,LON,ALT,HEADING", help="deg, deg, m above sea, deg"
    )
    parser.add_argument("--speedup", default=1.0, type=_speedup, help="simulated seconds per second")
    parser.add_argument("--epoch-ns", type=int, help="unix time, ns, at which simulated and real time agree")
    parser.add_argument(
        "--param", default=[], action="append", type=_parameter, metavar="NAME=VALUE", help="an ArduPilot parameter"
    )
    parser.add_argument("--ready-after", default=0.0, type=float, metavar="S", help="when its position is good, s")
    parser.add_argument("--seed", default=0, type=int, help="of the gusts (SIM_WIND_TURB)")
    parser.add_argument("--parent-pid", type=int, metavar="PID", help="end when this process does")
    options = parser.parse_args(_with_home_joined(argv))
    if options.epoch_ns is None:
        options.epoch_ns = time.time_ns()
    return options


def _with_home_joined(argv: Sequence[str]) -> list[str]:
    """Return the arguments with a southern home's minus sign protected from argparse."""
    joined: list[str] = []
    for argument in argv:
        if joined and joined[-1] == "--home":
            joined[-1] = f"--home={argument}"
        else:
            joined.append(argument)
    return joined


def _system_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 255:
        msg = f"{text!r} is not a system id: expected 1 to 255"
        raise argparse.ArgumentTypeError(msg)
    return int(text)


def _link(text: str) -> LinkAddress:
    try:
        return LinkAddress.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _home(text: str) -> tuple[GeoPoint, float]:
    try:
        latitude_deg, longitude_deg, altitude_m, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        latitude_deg = longitude_deg = altitude_m = heading_deg = float("nan")
    bounded = abs(latitude_deg) < 90.0 and abs(longitude_deg) <= 180.0
    if not (bounded and isfinite(altitude_m) and isfinite(heading_deg)):
        msg = f"{text!r} is not a home: expected LATITUDE,LONGITUDE,ALTITUDE_M,HEADING_DEG"
        raise argparse.ArgumentTypeError(msg)
    return GeoPoint(latitude_deg, longitude_deg, altitude_m), radians(heading_deg % 360.0)


def _speedup(text: str) -> float:
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor <= 100.0:
        msg = f"{text!r} is not a speedup: expected a number above 0, at most 100"
        raise argparse.ArgumentTypeError(msg)
    return factor


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = float("nan")
    if not Parameters().set(name, number):
        msg = f"{text!r} is not NAME=VALUE of a parameter; known are {', '.join(Parameters())}"
        raise argparse.ArgumentTypeError(msg)
    return name, number


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
