"""What is missing in the records of a run, and how much of them may be when the service was killed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

Missing = Callable[[str, str], None]
"""Is told of which vehicle something is missing, and what; of no vehicle in particular: an empty name."""

LOST_S: Final = 0.1
"""What came so long before the service was killed may be lost with it."""

NEVER_S: Final = float("inf")
"""When a service was killed that was not."""
