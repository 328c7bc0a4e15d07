"""`keys`: what closes the bus to strangers: a file of keys for every party, and the rights of all for the router."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from drivers.bus.certificates import Authority, now
from drivers.bus.keys import NAME_PATTERN
from drivers.bus.security import OPERATOR, ROUTER, SERVICE, configurations
from gcs.commands.options import PlaybookPath
from gcs.errors import ServiceError
from gcs.playbook.loader import load_playbook

SUFFIX: Final = ".json5"
_FOR: Final = {
    ROUTER: "the bus router, and nobody else",
    SERVICE: "the computer that flies the swarm",
    OPERATOR: "whoever may command the relay, and its screens",
}

app = typer.Typer(help="Keys that close the bus to strangers.", no_args_is_help=True)


@app.callback()
def keys() -> None:
    """Keys that close the bus to strangers."""


@app.command()
def init(
    path: PlaybookPath,
    out: Annotated[Path, typer.Option(help="a folder that is made for the files")],
    swarm: Annotated[str | None, typer.Option(help="the swarm, when it is not the playbook's name")] = None,
    router: Annotated[
        str | None, typer.Option(help="where the router listens, tls/HOST:PORT; without it the playbook's bus.router")
    ] = None,
    site: Annotated[
        list[str] | None,
        typer.Option(help="a site with a router of its own that connects to the other one: NAME=tls/HOST:PORT; repeat"),
    ] = None,
    days: Annotated[int, typer.Option(help="for how long the certificates hold", min=1, max=3650)] = 365,
) -> None:
    """Make keys for the router, the service, the operator and every UAV of a playbook: one file each, mode 0600.

    A UAV may then publish only its own bearings and clock answers, and only the operator may command. A site's router
    passes on what its own parties may say, and judges that itself. The authority behind them is not kept: for one more
    UAV, or after a loss, make all of them anew.
    """
    playbook = load_playbook(path)
    name, endpoint = swarm or playbook.name, router or playbook.bus.router
    if re.fullmatch(NAME_PATTERN, name) is None:
        raise ServiceError(f"{name!r} is no name of a swarm: --swarm takes the playbook's name")
    if endpoint is None:
        raise ServiceError("where does the router listen? Give --router tls/HOST:PORT, or bus.router in the playbook")
    nodes = sorted(set(playbook.nodes.values()))
    authority, sites = Authority(name, now(), days), _sites(site or [])
    made = configurations(name, list(playbook.uavs), endpoint, authority, nodes, sites)
    _write(out, made)
    table = Table(title=f"keys of {name} in {out}, for {days} days", title_style="bold", header_style="bold")
    table.add_column("file", no_wrap=True)
    table.add_column("belongs on", overflow="fold")
    for party in made:
        table.add_row(party + SUFFIX, _FOR.get(party) or _place_of(party))
    console = Console()
    console.print(table)
    console.print("Move each to where it belongs, over a way you trust, and delete it here.", soft_wrap=True)


def _sites(given: list[str]) -> dict[str, str]:
    """Return where the router of each site listens. ServiceError for what is no site, or one said twice."""
    sites: dict[str, str] = {}
    for each in given:
        name, _, endpoint = each.partition("=")
        if re.fullmatch(NAME_PATTERN, name) is None or not endpoint:
            raise ServiceError(f"{each!r} is no site: --site takes NAME=tls/HOST:PORT")
        if name in sites:
            raise ServiceError(f"site {name} is given twice: each has one router")
        sites[name] = endpoint
    return sites


def _place_of(party: str) -> str:
    """Return where the keys of a node, of a site's router or of a UAV belong."""
    kind, _, name = party.partition(".")
    if kind == ROUTER:
        return f"the bus router of site {name}, and nobody else"
    return f"the machine of link node {name}" if kind == "node" else f"the companion computer of {name}"


def _write(folder: Path, files: dict[str, str]) -> None:
    """Write files that only their owner can read into a new folder. ServiceError when that cannot be."""
    try:
        folder.mkdir(mode=0o700, parents=True)
        for name, text in files.items():
            descriptor = os.open(folder / (name + SUFFIX), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write(text)
    except FileExistsError as error:
        raise ServiceError(
            f"{error.filename} is there already: keys are not overwritten, name another folder"
        ) from error
    except OSError as error:
        raise ServiceError(f"{error.filename or folder} cannot be written: {error.strerror}") from error
