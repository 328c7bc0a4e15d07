"""Processes that outlive the command that started them: found again later, and ended, by id and start time.

A process id alone is nobody's name: once its process has ended, the system gives it to another.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from drivers.errors import SimulationError

PATIENCE_S: Final = 6.0
"""A process that ends others first, politely and then for certain, needs some."""
_STATE, _STARTED = 0, 19
"""Fields of /proc/PID/stat after the command's name: proc(5) counts them from 3."""


class DetachedProcess(msgspec.Struct, frozen=True):
    """A process that was started: its id, and when it began in clock ticks since the machine's boot."""

    pid: int
    started_ticks: int

    @classmethod
    def of(cls, pid: int) -> DetachedProcess:
        """Return the process that has this id now."""
        fields = _stat(pid)
        return cls(pid, int(fields[_STARTED]) if fields else 0)

    @property
    def runs(self) -> bool:
        """Whether this very process still runs."""
        fields = _stat(self.pid)
        return fields is not None and int(fields[_STARTED]) == self.started_ticks and fields[_STATE] not in ("Z", "X")


def start_detached(arguments: Sequence[str], log: Path, stdin: bytes) -> DetachedProcess:
    """Start a Python process of this installation that outlives this one. SimulationError when it cannot be."""
    try:
        with log.open("wb") as log_file:
            process = subprocess.Popen(  # noqa: S603 - this interpreter, no shell
                [sys.executable, *arguments],
                stdin=subprocess.PIPE,
                stdout=log_file,
                stderr=log_file,
                start_new_session=True,  # neither a Ctrl-C nor the end of the terminal is for it
            )
    except OSError as error:
        raise SimulationError(f"{arguments[1]} cannot be started: {error}") from error
    started = DetachedProcess.of(process.pid)
    with contextlib.suppress(OSError), process.stdin or contextlib.nullcontext() as pipe:  # its silence is noticed
        if pipe is not None:
            pipe.write(stdin)
    process.returncode = 0  # nobody is going to wait for it
    return started


def end(processes: Iterable[DetachedProcess], patience_s: float = PATIENCE_S) -> list[DetachedProcess]:
    """End those of the processes that still run, politely and then for certain; return those that would not end."""
    with contextlib.ExitStack() as opened:
        handles = {process: handle for process in processes if (handle := _open(process)) is not None}
        for handle in handles.values():
            opened.callback(os.close, handle)
        for number in (signal.SIGTERM, signal.SIGKILL):
            for handle in handles.values():
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    signal.pidfd_send_signal(handle, number)
            handles = _left(handles, patience_s)
    return list(handles)


def _open(process: DetachedProcess) -> int | None:
    """Return a handle on this very process, which stays with it whatever becomes of its id; None when it has ended."""
    try:
        handle = os.pidfd_open(process.pid)
    except OSError:
        return None
    if process.runs:
        return handle
    os.close(handle)
    return None


def _left(handles: dict[DetachedProcess, int], patience_s: float) -> dict[DetachedProcess, int]:
    """Wait until all have ended, not for ever; return the others."""
    ended, poll = set[int](), select.poll()
    for handle in handles.values():
        poll.register(handle, select.POLLIN)
    deadline_s = time.monotonic() + patience_s
    while len(ended) < len(handles) and (left_s := deadline_s - time.monotonic()) > 0.0:
        for handle, _ in poll.poll(left_s * 1e3):
            poll.unregister(handle)
            ended.add(handle)
    return {process: handle for process, handle in handles.items() if handle not in ended}


def _stat(pid: int) -> list[str] | None:
    """Return the fields of /proc/PID/stat after the command's name, or None where there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
