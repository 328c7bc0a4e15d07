"""`dashboard`: a run in any browser."""

from __future__ import annotations

import asyncio
import logging
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from drivers.bus.session import BusEndpoint, require_closed
from gcs.commands.options import BusKeys, RunsDir
from gcs.errors import ServiceError
from gcs.monitor.access import COMMAND_VARIABLE, VIEW_VARIABLE, read_tokens
from gcs.monitor.client import joining
from gcs.monitor.yielding import give_way


def dashboard(
    listen: Annotated[str, typer.Option(help="where to serve it, HOST:PORT")] = "127.0.0.1:8080",
    connect: Annotated[str | None, typer.Option(help="the bus router of the run, tcp/HOST:PORT")] = None,
    swarm: Annotated[
        str | None, typer.Option(help="the swarm: the playbook's name; without it the only one on the bus")
    ] = None,
    run: Annotated[Path | None, typer.Option(help="the folder of the run; without it always the newest run")] = None,
    runs_dir: RunsDir = Path("runs"),
    keys: BusKeys = None,
    view_token_file: Annotated[
        Path | None, typer.Option(help=f"file with the token for viewing; else {VIEW_VARIABLE}; else all may view")
    ] = None,
    command_token_file: Annotated[
        Path | None,
        typer.Option(help=f"file with the token for commanding; else {COMMAND_VARIABLE}; else commanding is off"),
    ] = None,
    certificate: Annotated[Path | None, typer.Option(help="PEM certificate: serve it over TLS")] = None,
    key: Annotated[Path | None, typer.Option(help="the certificate's key, PEM")] = None,
    insecure: Annotated[
        bool,
        typer.Option(
            "--insecure",
            help="off loopback without TLS, and a bus without keys: others can read and change it",
        ),
    ] = False,
    parent_pid: Annotated[int | None, typer.Option(hidden=True)] = None,
) -> None:
    """Show a run in a browser: the one named, else the newest, and the next when one begins. Ctrl-C ends it."""
    if find_spec("nicegui") is None:
        raise ServiceError("the dashboard needs NiceGUI: pip install 'bearing-relay[dashboard]'")
    from gcs.monitor.web.finding import RunFinder  # noqa: PLC0415 - it is an extra
    from gcs.monitor.web.place import place_of  # noqa: PLC0415
    from gcs.monitor.web.server import serve  # noqa: PLC0415

    if connect is not None and keys is None:
        require_closed(BusEndpoint(connect, insecure=insecure))
    place = place_of(listen, certificate, key, insecure=insecure)
    tokens = read_tokens(view_token_file, command_token_file)
    finder, join = RunFinder(runs_dir, run, connect, swarm, insecure), joining(keys)
    console = Console(soft_wrap=True, highlight=False, markup=False)
    logging.basicConfig(format="%(asctime)s %(message)s")
    logging.getLogger("gcs.monitor.web").setLevel(logging.INFO)
    give_way()

    def ready() -> None:
        commanding = "off: no token is set for it" if tokens.command is None else "with the token for it"
        console.print(f"dashboard at {place.url}  (commanding: {commanding})")

    asyncio.run(serve(place, tokens, finder, join=join, parent_pid=parent_pid, ready=ready))
