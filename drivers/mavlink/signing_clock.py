"""The clock that stamps signatures: one for every link of the process, and it never goes back.

Timestamps count 10 us since 2015-01-01 UTC. No timestamp is used before a state file holds a later one, so that
none comes twice: not after a crash, nor when the machine's time is set back.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import logging
import math
import os
import re
import tempfile
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Final

from drivers.clock import Clock
from drivers.tasks import background

log = logging.getLogger(__name__)

UNITS_PER_S: Final = 100_000
_NS_PER_UNIT: Final = 10_000
_EPOCH_UNIX_NS: Final = 1_420_070_400 * 10**9
_RESERVE: Final = 10 * UNITS_PER_S
"""How far the state file is ahead: what a crash skips at most, small against the minute a peer tolerates."""
_LATEST: Final = 2**48 - 2**40
"""A timestamp has 48 bits; no later one is believed, so that counting on from it has room for months."""


class SigningClock:
    """Hands out timestamps, each later than all before. Made by `open_signing_clock`."""

    def __init__(self, clock: Clock, last: int = 0) -> None:
        self._clock = clock
        self._last = last
        self._heard = 0
        self._reserved: float = math.inf
        self._wake = asyncio.Event()

    def now(self) -> int:
        """Return the time by this clock: the machine's, or a later one that was heard or handed out."""
        wall = (self._clock.unix_ns() - _EPOCH_UNIX_NS) // _NS_PER_UNIT
        return max(self._last, self._heard, min(wall, _LATEST))

    def next(self) -> int:
        """Return the timestamp of the next signature."""
        now = self.now()
        if now + _RESERVE // 2 > self._reserved:
            self._wake.set()
        self._last = max(self._last + 1, int(min(now, self._reserved)))  # past the reserve only when the disk hangs
        return self._last

    def hear(self, timestamp: int) -> None:
        """Run on from a timestamp that somebody who holds the key has used, when it is later than ours."""
        self._heard = max(self._heard, min(timestamp, _LATEST))

    async def reserve(self, path: Path) -> None:
        """Put a timestamp ahead of all that are handed out into the state file; OSError when it cannot be written."""
        ahead = self.now() + _RESERVE
        await asyncio.to_thread(_write, path, ahead)
        self._reserved = ahead

    async def keep_reserved(self, path: Path) -> None:
        """Keep the state file ahead of what is handed out; return when it can no longer be written."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            try:
                await self.reserve(path)
            except OSError as error:
                self._reserved = math.inf
                _warn_not_kept(path, error)
                return

    def close(self, path: Path) -> None:
        """Leave in the state file what was really handed out."""
        with contextlib.suppress(OSError):  # then it is further ahead than it needs to be
            _write(path, self._last)


def default_state_file() -> Path:
    """Return where the last timestamp is kept: under XDG_STATE_HOME."""
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    base = given if given.is_absolute() else Path.home() / ".local" / "state"
    return base / "bearing-relay" / "signing-timestamp"


@contextlib.asynccontextmanager
async def open_signing_clock(clock: Clock, path: Path | None = None) -> AsyncIterator[SigningClock]:
    """Yield the process's signing clock, its state kept in `path`. Give the machine's time, never a simulation's.

    Where the state cannot be kept, a warning says so and the clock runs without.
    """
    path = default_state_file() if path is None else path
    async with contextlib.AsyncExitStack() as stack:
        yield await _kept(clock, path, stack)


async def _kept(clock: Clock, path: Path, stack: contextlib.AsyncExitStack) -> SigningClock:
    try:
        stack.enter_context(_locked(path))
        signing_clock = SigningClock(clock, _read(path))
        await signing_clock.reserve(path)
    except BlockingIOError as error:
        _warn_not_kept(path, error)
        return SigningClock(clock)  # beside the other process, not ahead of it: vehicles may hear both
    except OSError as error:
        _warn_not_kept(path, error)
        return SigningClock(clock, _read(path))
    stack.callback(signing_clock.close, path)
    await stack.enter_async_context(background(signing_clock.keep_reserved(path)))
    return signing_clock


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the state file for this process alone; OSError when it is held or cannot be."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BlockingIOError(error.errno, "another process of this user signs at the same time") from error
        yield
    finally:
        os.close(descriptor)


def _read(path: Path) -> int:
    try:
        text = path.read_text(encoding="ascii")
    except (FileNotFoundError, NotADirectoryError):
        return 0
    except (OSError, UnicodeError) as error:
        log.warning("%s: the last signing timestamp cannot be read (%s): the machine's time is used", path, error)
        return 0
    if not re.fullmatch(r"\d{1,15}\n?", text) or int(text) > _LATEST:
        log.warning("%s: holds no signing timestamp: the machine's time is used", path)
        return 0
    return int(text)


def _write(path: Path, timestamp: int) -> None:
    """Replace the state file; when this returns it survives a loss of power."""
    descriptor, temporary = tempfile.mkstemp(prefix=path.name, suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{timestamp}\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _warn_not_kept(path: Path, error: OSError) -> None:
    log.warning(
        "%s: the signing timestamp is not kept (%s). Signing goes on, but a vehicle refuses this station while the "
        "timestamps are behind those it has seen: after the machine's time was set back, or beside another process",
        path,
        error.strerror or error,
    )
