"""An autopilot's time since its boot, and what it tells of a reboot."""

from __future__ import annotations

from typing import Final

_JITTER_S: Final = 0.5
"""Messages of one moment are stamped at different times, and overtake each other."""
_DELAY_S: Final = 2.0
"""How much longer than others one message may have been under way."""


class BootClock:
    """The newest time since boot that was heard of.

    A smaller one is a message that comes late, unless the autopilot can have been switched on since the newest came.
    """

    def __init__(self) -> None:
        self._newest_s: float | None = None
        self._heard_s = 0.0

    def restarted(self, boot_s: float, now_s: float) -> bool:
        """Take in a time since boot, s, heard at `now_s`; return whether there was a reboot since the last one."""
        newest_s = self._newest_s
        if newest_s is not None and boot_s <= newest_s:
            reboot = boot_s < newest_s - _JITTER_S and boot_s <= now_s - self._heard_s + _DELAY_S
            if not reboot:
                return False
        self._newest_s, self._heard_s = boot_s, now_s
        return newest_s is not None and boot_s <= newest_s

    def forget(self) -> None:
        """Begin anew with the next time heard of."""
        self._newest_s = None
