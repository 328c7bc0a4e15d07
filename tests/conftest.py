"""What holds for all tests: machines are shared, so no example is too slow, and the longest files begin first."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what starts processes: workers side by side then end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(autouse=True)
def among_equals(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no screen that is started inside a test give way: all tests after it would, in this process."""
    monkeypatch.setattr(os, "nice", lambda increment: increment)
