"""The safety case names what exists: every module, class, function and test in it is there."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CASE = (ROOT / "gcs" / "SAFETY.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"`([^`\n]+)`", CASE)
TESTS = sorted({quoted for quoted in QUOTED if quoted.startswith("tests/")})
PARTS = sorted({quoted for quoted in QUOTED if re.fullmatch(r"(?:gcs|drivers|planner)(?:\.\w+)+", quoted)})
FILES = sorted({quoted for quoted in QUOTED if quoted.startswith("sitl_configs/")})
HAZARDS = re.split(r"^## (?=H\d)", CASE.split("\n## What is left")[0], flags=re.MULTILINE)[1:]


def defined_in(path: Path) -> set[str]:
    """Return the names a module defines at its top level, without importing it."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def found(dotted: str) -> object:
    """Return the module or the member of one that a dotted name means; raise when there is none."""
    words = dotted.split(".")
    for end in range(len(words), 0, -1):
        try:
            value: object = importlib.import_module(".".join(words[:end]))
        except ModuleNotFoundError:
            continue
        for word in words[end:]:
            value = getattr(value, word)
        return value
    raise ModuleNotFoundError(dotted)


@pytest.mark.parametrize("named", TESTS)
def test_every_test_it_names_exists(named: str) -> None:
    path, _, test = named.partition("::")
    assert (ROOT / path).is_file()
    assert not test or (test.lower().startswith("test") and test in defined_in(ROOT / path))


@pytest.mark.parametrize("named", PARTS)
def test_everything_that_is_said_to_stop_a_hazard_exists(named: str) -> None:
    assert found(named) is not None


@pytest.mark.parametrize("named", FILES)
def test_every_file_it_names_exists(named: str) -> None:
    assert (ROOT / named).is_file()


def test_every_hazard_says_what_stops_it_what_shows_that_and_what_is_missing() -> None:
    assert [int(hazard[1:].split()[0]) for hazard in HAZARDS] == list(range(1, len(HAZARDS) + 1))
    for hazard in HAZARDS:
        stopped, _, rest = hazard.partition("\nStopped by\n")[2].partition("\nShown by\n")
        shown, _, gaps = rest.partition("\nGaps: ")
        assert any(f"`{part}`" in stopped for part in PARTS), hazard
        assert any(f"`{test}`" in shown for test in TESTS if "::" in test), hazard
        assert gaps.strip(), hazard


@pytest.mark.parametrize("wrong", ["gcs.no_such_module", "gcs.safety.NoSuchClass", "gcs.safety.Safety.no_such_method"])
def test_what_does_not_exist_is_noticed(wrong: str) -> None:
    with pytest.raises((ModuleNotFoundError, AttributeError)):
        found(wrong)
    assert "test_no_such_test" not in defined_in(Path(__file__))
