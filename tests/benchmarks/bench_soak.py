"""Hours of relays, faster than real time: does anything grow that should not?

    python -m tests.benchmarks.bench_soak [--hours H] [--hover-hours H] [PLAYBOOK]
    python -m tests.benchmarks.bench_soak --flights N [--speedup X] [PLAYBOOK]

Without `--flights` everything is in one process and in virtual time: relays again and again for `--hours` of simulated
time, then one swarm that is heard for `--hover-hours` after its relay. After every relay, or five minutes of hovering,
it collects garbage, and notes the process's memory, descriptors, threads, tasks and objects, and how the relay went.

With `--flights` real processes fly the playbook so often on one bus, and what is noted is of those that live through it
all: the bus router, the dashboard, and a screen attached to the bus.

The trend is that of the second half: its slope by least squares, per simulated hour or per flight, and the standard
error of that. Exits 1 when something grows: by more than three standard errors, and than its smallest step that counts.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import gc
import math
import os
import sys
import tempfile
import threading
import time
import urllib.request
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from drivers.simulation.launcher import free_tcp_port
from drivers.tasks import background
from gcs.monitor.client import RunClient
from gcs.playbook.loader import load_playbook
from gcs.recording.bus_address import BusAddress
from gcs.simulate.bus import LocalBus
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from gcs.simulate.world import RelayWorld
from tests.benchmarks.answering import held_by, process, router

COUNTS = {"memory MB": 1.0, "descriptors": 1.0, "threads": 3.0, "tasks": 1.0, "objects": 100.0}
"""What must not grow, and how much more at the end of the second half than at its beginning counts as growth: pools of
threads fill up to a handful."""
_SIGMAS = 3.0
_HOVER_STEP_S = 300.0
_FEWEST = 8


@dataclass
class Series:
    """Samples against simulated time, h, or the number of flights."""

    unit: str
    at: list[float] = field(default_factory=list)
    samples: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def note(self, at: float, figures: dict[str, float]) -> None:
        """Add what was found at one time."""
        self.at.append(at)
        for name, value in figures.items():
            self.samples[name].append(value)

    def judged(self) -> bool:
        """Print the trend of everything; return whether nothing grows that must not."""
        half = len(self.at) // 2
        at = np.array(self.at[half:])
        print(f"  {'':24}{'first':>10}{'middle':>10}{'last':>10}{'slope':>12}{'std. error':>12} per {self.unit}")
        well = len(at) >= _FEWEST
        for name, values in self.samples.items():
            slope, error = trend(at, np.array(values[half:]))
            smallest = next((step for count, step in COUNTS.items() if name.endswith(count)), math.inf)
            grows = slope * (at[-1] - at[0]) > smallest and slope > _SIGMAS * error
            well = well and not grows
            print(
                f"  {name:24}{values[0]:10.1f}{values[half]:10.1f}{values[-1]:10.1f}{slope:12.4f}{error:12.4f}"
                f"{'  GROWS' if grows else ''}"
            )
        print(f"  {len(self.at)} samples{'' if len(at) >= _FEWEST else ': too few to tell'}", flush=True)
        return well


def trend(at: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the slope by least squares and its standard error; (0, inf) where there is too little to tell."""
    if len(at) < _FEWEST:
        return 0.0, math.inf
    off = at - at.mean()
    slope = float(off @ values / (off @ off))
    residuals = values - values.mean() - slope * off
    return slope, math.sqrt(float(residuals @ residuals) / (len(at) - 2) / float(off @ off))


def this_process() -> dict[str, float]:
    """Return what this process holds, after a garbage collection."""
    gc.collect()
    figures = held_by(os.getpid())
    figures["threads"] = float(threading.active_count())
    return figures | {"tasks": float(len(asyncio.all_tasks())), "objects": float(len(gc.get_objects()))}


# In virtual time


async def relays(playbook_path: Path, hours: float) -> bool:
    """Fly relay after relay, each of another seed."""
    playbook = load_playbook(playbook_path)
    plan, clock, series, seed = playbook.plan(), VirtualClock(), Series("simulated hour"), 0
    formed = 0
    while clock.now_s() < 3600.0 * hours:
        seed += 1
        world = RelayWorld(playbook, plan, clock, LocalBus(), seed=seed)
        began_s = clock.now_s()
        await world.run(600.0 + 20.0 * plan.makespan_s)
        formed += world.executor.formed
        figures = {"relay s": clock.now_s() - began_s, "worst error m": max(world.errors_m().values())}
        del world
        series.note(clock.now_s() / 3600.0, this_process() | figures)
    print(f"{seed} relays of {playbook.name}, {formed} formed, in {clock.now_s() / 3600.0:.1f} simulated hours")
    return series.judged() and formed == seed


async def hovering(playbook_path: Path, hours: float) -> bool:
    """Fly one relay, and go on hearing everybody."""
    playbook = load_playbook(playbook_path)
    plan, clock, series = playbook.plan(), VirtualClock(), Series("simulated hour")
    world = RelayWorld(playbook, plan, clock, LocalBus(), seed=1)
    await world.run(600.0 + 20.0 * plan.makespan_s)
    world.on_air |= playbook.transmitters.keys()
    async with background(world.clocks.run()):
        while clock.now_s() < 3600.0 * hours:
            await world.hover(_HOVER_STEP_S)
            series.note(clock.now_s() / 3600.0, this_process())
    print(f"{clock.now_s() / 3600.0:.1f} simulated hours of one run: {world.feed.counters}")
    return series.judged()


# Real processes


def flights(playbook_path: Path, count: int, speedup: float) -> bool:
    """Fly the playbook with real processes on one bus, watched by one dashboard and one screen."""
    series, port, failed = Series("flight"), free_tcp_port(), 0
    with router() as (endpoint, router_pid), tempfile.TemporaryDirectory() as folder:
        described = yaml.safe_load(playbook_path.read_text(encoding="utf-8")) | {"bus": {"router": endpoint}}
        flown = Path(folder) / "soak.yaml"
        flown.write_text(yaml.safe_dump(described), encoding="utf-8")
        swarm = described["name"]
        this = ("-m", "tests.benchmarks.bench_soak", "--role")
        serving = ("-m", "gcs.cli", "dashboard", "--connect", endpoint, "--swarm", swarm)
        with (
            process(*serving, "--listen", f"127.0.0.1:{port}") as dashboard,
            process(*this, "screen", endpoint, swarm) as screen,
        ):
            living = {"router": router_pid, "dashboard": dashboard.pid, "screen": screen.pid}
            for number in range(1, count + 1):
                runs = Path(folder) / f"runs-{number}"
                options = ("--speedup", str(speedup), "--seed", str(number), "--runs-dir", str(runs))
                with process("-m", "gcs.cli", "fly", str(flown), *options) as flight:
                    failed += flight.wait() != 0
                with contextlib.suppress(OSError):
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=10.0).close()
                time.sleep(2.0)
                series.note(
                    number,
                    {f"{name} {what}": value for name, pid in living.items() for what, value in held_by(pid).items()},
                )
    print(f"{count} flights of {swarm} at {speedup:g} x, {failed} failed")
    return series.judged()


async def screen(endpoint: str, swarm: str) -> None:
    """Follow every run on a bus, as a screen does."""
    await RunClient(lambda: BusAddress(endpoint, swarm)).follow()


def main(options: argparse.Namespace) -> int:
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors", flush=True)
    began_s = time.monotonic()
    if options.flights:
        well = flights(options.playbook, options.flights, options.speedup)
    else:
        well = run_virtually(relays(options.playbook, options.hours))
        well = run_virtually(hovering(options.playbook, options.hover_hours)) and well
    print(f"took {time.monotonic() - began_s:.0f} s; nothing grows: {'yes' if well else 'NO'}")
    return 0 if well else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0, help="simulated hours of relays")
    parser.add_argument("--hover-hours", type=float, default=8.0, help="simulated hours of one run")
    parser.add_argument("--flights", type=int, default=0, help="fly so often with real processes instead")
    parser.add_argument("--speedup", type=float, default=5.0)
    parser.add_argument("--role", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("playbook", type=Path, nargs="?", default=Path("sitl_configs/paper_8.yaml"))
    given = parser.parse_args()
    if given.role:
        asyncio.run(screen(*given.role[1:]))
    else:
        sys.exit(main(given))
