"""The bus router as its own process: `python -m drivers.bus.router tcp/127.0.0.1:7447`."""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from drivers.bus.routing import route
from drivers.bus.session import BusEndpoint
from drivers.errors import BusError


def main() -> int:
    """Route until told to stop; 2 when the endpoint cannot be listened on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("endpoint", help="where to listen, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--keys", type=Path, help="the router's file of `bearing-relay keys init`")
    parser.add_argument(
        "--insecure", action="store_true", help="off loopback without keys: whoever reaches it can join"
    )
    parser.add_argument("--parent-pid", type=int, help="end when this process has ended")
    arguments = parser.parse_args()
    endpoint = BusEndpoint(arguments.endpoint, role="router", insecure=arguments.insecure)
    try:
        asyncio.run(route(endpoint, arguments.keys, arguments.parent_pid))
    except BusError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
