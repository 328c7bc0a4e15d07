"""The waits between attempts to connect: each twice as long as the one before, up to a cap."""

from __future__ import annotations

import asyncio
import logging

from drivers.mavlink.transport import LinkAddress

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0


class Retry:
    """Waits after failures; the first of a row is a warning, the others are for who debugs."""

    def __init__(self, address: LinkAddress) -> None:
        self._address = address
        self._wait_s = FIRST_RETRY_S

    def succeeded(self) -> None:
        """End a row of failures."""
        self._wait_s = FIRST_RETRY_S

    async def failed(self, why: object) -> None:
        """Say why an attempt failed, and return when it is time for the next."""
        level = logging.WARNING if self._wait_s == FIRST_RETRY_S else logging.DEBUG
        log.log(level, "%s: %s; trying again in %.1f s", self._address, why, self._wait_s)
        wait_s, self._wait_s = self._wait_s, min(2 * self._wait_s, LONGEST_RETRY_S)
        await asyncio.sleep(wait_s)
