"""What a run was flown with: the versions of this program and of what it stands on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Final

_PACKAGES: Final = ("bearing-relay", "pymavlink", "eclipse-zenoh", "numpy", "scipy", "msgspec", "pydantic", "mcap")


def versions() -> dict[str, str]:
    """Return every version by name, as it will be looked for when a run has to be explained."""
    packages = {name: _version(name) for name in _PACKAGES}
    return {**packages, "python": platform.python_version(), "platform": platform.platform()}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"
