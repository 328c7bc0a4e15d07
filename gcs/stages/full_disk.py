"""A disk that is full for this process: the system itself refuses whatever it writes into any file, until it is freed.

Nothing that writes can be forgotten so, and nothing has to know of it. Sockets, pipes and terminals are no files.
"""

from __future__ import annotations

import resource
from dataclasses import dataclass, field


@dataclass
class FullDisk:
    """Full for as long as it has been filled more often than freed."""

    _before: list[int] = field(default_factory=list)

    def fill(self) -> None:
        """Let no file grow any more."""
        largest, allowed = resource.getrlimit(resource.RLIMIT_FSIZE)
        self._before.append(largest)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, allowed))

    def free(self) -> None:
        """Let files grow again, as far as they could before."""
        _, allowed = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (self._before.pop(), allowed))
