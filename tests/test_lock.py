"""requirements.lock: what CI installs is what pyproject.toml asks for, to the byte, from nowhere in particular."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
RENEW = "renew requirements.lock as CONTRIBUTING.md says"
PINNED = re.compile(r"(?m)^(\S+==[^\\\n]+?) ?\\?\n((?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)*)")


def wanted() -> list[Requirement]:
    """Everything that pyproject.toml asks for, by whatever name."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    lists = [pyproject["project"]["dependencies"], pyproject["build-system"]["requires"]]
    lists += [*pyproject["project"]["optional-dependencies"].values(), *pyproject["dependency-groups"].values()]
    return [Requirement(text) for texts in lists for text in texts if not text.startswith(pyproject["project"]["name"])]


def locked() -> dict[str, Version]:
    """What the lock holds for the Python that this is run with."""
    pins = [Requirement(found[1]) for found in PINNED.finditer((ROOT / "requirements.lock").read_text())]
    return {
        canonicalize_name(pin.name): Version(next(iter(pin.specifier)).version)
        for pin in pins
        if pin.marker is None or pin.marker.evaluate()
    }


@pytest.mark.parametrize("requirement", wanted(), ids=str)
def test_the_lock_satisfies_what_is_asked_for(requirement: Requirement) -> None:
    version = locked().get(canonicalize_name(requirement.name))
    assert version is not None, f"{requirement} is not locked: {RENEW}"
    assert version in requirement.specifier, f"{requirement.name} is locked at {version}: {RENEW}"


def test_what_is_locked_is_all_that_it_needs() -> None:
    pins, environment = locked(), {**default_environment(), "extra": ""}
    for found in distributions():
        name = canonicalize_name(found.metadata["Name"])
        if name == "mavproxy" or pins.get(name) != Version(found.version):
            continue  # what is not of the lock does not matter, and what MAVProxy wants is more than it needs here
        for need in map(Requirement, found.requires or ()):
            if need.marker is None or need.marker.evaluate(environment):
                version = pins.get(canonicalize_name(need.name))
                assert version is not None, f"{name} needs {need}: {RENEW}"
                assert need.specifier.contains(version, prereleases=True), (
                    f"{name} needs {need}, not {version}: {RENEW}"
                )


def test_every_file_is_known_by_its_hash_and_none_by_where_it_is() -> None:
    text = (ROOT / "requirements.lock").read_text()
    pins = PINNED.findall(text)
    assert len(pins) == len(re.findall(r"(?m)^\S+==", text)) > 100
    assert all("--hash" in hashes for _, hashes in pins)
    assert not re.search(r"(?m)^\s*-(?!-hash)|^[^#]*(://|file:)", text)
