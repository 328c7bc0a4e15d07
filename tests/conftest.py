"""What holds for all tests: machines are shared, so that no example is too slow."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")
