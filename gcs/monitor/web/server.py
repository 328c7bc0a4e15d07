"""Serves the dashboard until told to stop: a process of its own; nothing that happens to it reaches a flight."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Final

import uvicorn

from drivers.bus.openness import is_loopback
from drivers.bus.session import open_bus
from drivers.clock import SystemClock
from drivers.process import until_told_to_stop
from drivers.tasks import background
from gcs.monitor.access import Tokens, require_guarded
from gcs.monitor.client import OpenBus, following
from gcs.monitor.proven import proving
from gcs.monitor.web.app import dashboard_app
from gcs.monitor.web.finding import RunFinder
from gcs.monitor.web.place import Place, listening, require_certificate

_LARGEST_WORD: Final = 65_536


async def serve(
    place: Place,
    tokens: Tokens,
    finder: RunFinder,
    *,
    join: OpenBus = open_bus,
    parent_pid: int | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Serve the dashboard until SIGINT, SIGTERM, or the process `parent_pid` has ended.

    ServiceError when it may not be served there, or cannot.
    """
    require_guarded(place.host, tokens, tls=place.tls, insecure=place.insecure)
    require_certificate(place)
    with listening(place) as listener:
        async with following(finder.find, proving(tokens.command), join) as client:
            gate = dashboard_app(client, finder, tokens, SystemClock(), tls=place.tls, loopback=is_loopback(place.host))
            server = _Server(_configuration(place, gate))
            async with background(_end(server, parent_pid)):
                ready()
                await server.serve(sockets=[listener])


def _configuration(place: Place, gate: object) -> uvicorn.Config:
    return uvicorn.Config(
        gate,  # type: ignore[arg-type]  # a frozen dataclass is called like the function they ask for
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,  # nobody may say for himself where he comes from
        ws_per_message_deflate=False,
        ws_max_size=_LARGEST_WORD,
        timeout_graceful_shutdown=1,
        ssl_certfile=place.certificate,
        ssl_keyfile=place.key,
    )


class _Server(uvicorn.Server):
    """Leaves the signals alone: one that kills the process here would leave the bus open."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def _end(server: uvicorn.Server, parent_pid: int | None) -> None:
    await until_told_to_stop(parent_pid)
    server.should_exit = True
