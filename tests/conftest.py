"""What holds for all tests: machines are shared, so no example is too slow, and the longest files begin first."""

from __future__ import annotations

import pytest
from hypothesis import settings

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what starts processes: workers side by side then end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
