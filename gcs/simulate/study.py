"""A study: many simulated relays that differ in their noise alone, on all processors, resumable.

Its folder holds what was flown (`playbook.json`, `plan.json`, `study.json`) and a line of JSON for each run
(`runs.jsonl`), synced before it counts as done; runs finish in no order.
"""

from __future__ import annotations

import contextlib
import importlib
import itertools
import os
import signal
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import IO, Any, Final

import msgspec

from drivers.strict_json import read_json
from gcs.errors import ServiceError
from gcs.playbook.schema import Playbook
from gcs.recording.run_folder import write_json
from gcs.simulate.outcome import RunResult, fly_once
from gcs.simulate.world import Stop
from planner.plan import RelayPlan, plan_to_json

_RUNS: Final = "runs.jsonl"
_LARGEST_CHUNK: Final = 4
_CHUNKS_PER_WORKER: Final = 8
_WAITING_PER_WORKER: Final = 2
_DASK_TIMEOUT_S: Final = 10.0


@dataclass(frozen=True)
class Study:
    """What is flown, again and again."""

    playbook: Playbook
    plan: RelayPlan
    stop: Stop = "filtered"

    @property
    def files(self) -> dict[str, Any]:
        """What says so in its folder, by the name of the file."""
        return {
            "playbook.json": self.playbook.model_dump(mode="json"),
            "plan.json": plan_to_json(self.plan),
            "study.json": {"stop": self.stop},
        }


@dataclass(frozen=True)
class StudyFolder:
    """Where a study keeps what is done."""

    path: Path

    @classmethod
    def create(cls, path: Path, study: Study) -> StudyFolder:
        """Make a new folder for a study. ServiceError when it is there already, or cannot be made."""
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            raise ServiceError(f"{path} exists: go on with it by --resume {path}, or name another folder") from None
        except OSError as error:
            raise ServiceError(f"the folder {path} cannot be made: {error.strerror or error}") from error
        for name, told in study.files.items():
            write_json(path / name, told)
        return cls(path)

    @classmethod
    def resume(cls, path: Path, study: Study) -> StudyFolder:
        """Open the folder of the same study. ServiceError when it is no such folder."""
        for name, now in study.files.items():
            try:
                before = read_json((path / name).read_bytes(), dict)
            except (OSError, msgspec.DecodeError) as error:
                raise ServiceError(f"{path} is no study to resume: {name} cannot be read ({error})") from error
            if before != msgspec.json.decode(msgspec.json.encode(now)):
                raise ServiceError(
                    f"{path} is a study of another playbook, or of other options ({name} differs): "
                    "give the same again, or begin a new one"
                )
        return cls(path)

    def results(self) -> list[RunResult]:
        """Return the runs done, by seed; a last line that was cut off is left out. ServiceError when one is no run."""
        try:
            lines = (self.path / _RUNS).read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise ServiceError(f"{self.path / _RUNS} cannot be read: {error.strerror or error}") from error
        by_seed: dict[int, RunResult] = {}
        for number, line in enumerate(lines, start=1):
            if not line.endswith(b"\n"):
                continue
            try:
                run = read_json(line, RunResult)
            except msgspec.MsgspecError as error:
                raise ServiceError(f"{self.path / _RUNS}:{number}: no run of a study: {error}") from error
            by_seed[run.seed] = run
        return [by_seed[seed] for seed in sorted(by_seed)]

    @contextlib.contextmanager
    def appending(self) -> Iterator[Callable[[RunResult], None]]:
        """Yield what adds a run, on disk when it returns. ServiceError when that fails."""
        path = self.path / _RUNS
        try:
            with path.open("r+b" if path.exists() else "w+b") as file:
                _drop_cut_off_line(file)
                yield lambda run: _append(file, run)
        except OSError as error:
            raise ServiceError(f"{path} cannot be written: {error.strerror or error}") from error


def fly_study(
    study: Study,
    seeds: Collection[int],
    folder: StudyFolder,
    pool: Executor,
    workers: int,
    done: Callable[[RunResult], None],
) -> None:
    """Fly every seed that the folder does not hold yet; `done` is told each run when it is on disk.

    What is not flown when this is interrupted is not waited for.
    """
    known = {run.seed for run in folder.results()}
    chunks = iter(_chunks([seed for seed in seeds if seed not in known], workers))
    waiting: set[Future[list[RunResult]]] = set()
    with folder.appending() as append:
        try:
            while True:
                for chunk in itertools.islice(chunks, _WAITING_PER_WORKER * workers - len(waiting)):
                    waiting.add(pool.submit(fly_many, study, chunk))
                if not waiting:
                    return
                finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for run in itertools.chain.from_iterable(future.result() for future in finished):
                    append(run)
                    done(run)
        finally:
            for future in waiting:
                future.cancel()


def fly_many(study: Study, seeds: Sequence[int]) -> list[RunResult]:
    """Fly one relay for each seed, in this process."""
    return [fly_once(study.playbook, study.plan, seed, study.stop) for seed in seeds]


@contextlib.contextmanager
def local_pool(workers: int) -> Iterator[Executor]:
    """Yield processes on this machine; when the block fails or is interrupted they end at once."""
    others = set(active_children())
    pool = ProcessPoolExecutor(
        workers, get_context("spawn"), initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_DFL)
    )
    try:
        yield pool
    except BaseException:
        for process in set(active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def dask_pool(address: str) -> Iterator[tuple[Executor, int]]:
    """Yield a Dask cluster's workers, and how many there are. ServiceError when it cannot be reached."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise ServiceError("--dask takes dask: pip install 'bearing-relay[study]'") from error
    try:
        client = distributed.Client(address, timeout=_DASK_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ServiceError(f"the Dask scheduler at {address} cannot be reached: {error}") from error
    with client:
        yield client.get_executor(), max(1, len(client.scheduler_info()["workers"]))


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _chunks(seeds: Sequence[int], workers: int) -> Iterator[Sequence[int]]:
    """Yield seeds in portions: few to a portion when there are few, so that all workers have some to the end."""
    size = max(1, min(_LARGEST_CHUNK, len(seeds) // (_CHUNKS_PER_WORKER * workers)))
    return (seeds[first : first + size] for first in range(0, len(seeds), size))


def _append(file: IO[bytes], run: RunResult) -> None:
    file.write(msgspec.json.encode(run) + b"\n")
    file.flush()
    os.fsync(file.fileno())


def _drop_cut_off_line(file: IO[bytes]) -> None:
    """Leave the file at the end of its last whole line: a run cut off while it was written is flown again."""
    whole = file.read().rpartition(b"\n")
    file.seek(len(whole[0]) + len(whole[1]))
    file.truncate()
