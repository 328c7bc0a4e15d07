"""Reads playbooks: every problem of a file at once, each with file:line:column, what was found and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from gcs.errors import ServiceError
from gcs.playbook.formation import KINDS
from gcs.playbook.schema import Playbook, Site
from gcs.playbook.slot_files.slots import SlotFileError, Surroundings
from planner.frames import FormationFrame, GeodeticPosition

_LARGEST_FILE_BYTES = 4_000_000
_NOT_IN_THE_FILE = (*KINDS, "[key]")
"""Parts of pydantic's locations that are no keys: which formation it took, and that a key itself is wrong."""


@dataclass(frozen=True)
class PlaybookProblem:
    """One thing wrong in a playbook, where it stands (counted from 1)."""

    path: Path
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}: {self.message}"


class PlaybookError(ServiceError):
    """A playbook cannot be used; `problems` is all that is wrong with it."""

    def __init__(self, problems: Sequence[PlaybookProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, problems)))


def load_playbook(path: Path) -> Playbook:
    """Return the playbook in a YAML file; PlaybookError with every problem it has."""
    document = _read_yaml(path)
    plain = _plain(document)
    try:
        return Playbook.model_validate(plain, context=Surroundings(path.parent, _site(plain)))
    except ValidationError as error:
        problems = [problem for details in error.errors() for problem in _problems(path, document, details)]
        raise PlaybookError(problems) from error


def _site(plain: Mapping[str, Any]) -> tuple[GeodeticPosition, FormationFrame] | None:
    """Return where the playbook's formation stands; None when that is not right, which validation then says."""
    try:
        site = Site.model_validate(plain.get("site", {}))
    except ValidationError:
        return None
    return site.origin, site.frame


def _read_yaml(path: Path) -> CommentedMap:
    try:
        if path.stat().st_size > _LARGEST_FILE_BYTES:
            raise PlaybookError([PlaybookProblem(path, 1, 1, "is too large to be a playbook (over 4 MB)")])
        document = YAML(typ="rt").load(path.read_text(encoding="utf-8"))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise PlaybookError([PlaybookProblem(path, line, column, f"is not YAML: {error.problem}")]) from error
    except (OSError, UnicodeDecodeError, YAMLError, RecursionError, ValueError) as error:
        raise PlaybookError([PlaybookProblem(path, 1, 1, f"cannot be read: {error}")]) from error
    if not isinstance(document, CommentedMap):
        raise PlaybookError([PlaybookProblem(path, 1, 1, "is not a mapping of playbook sections")])
    return document


def _plain(node: Any) -> Any:
    """Return the node as plain dicts, lists and scalars (ruamel's own scalar classes would fail strict checks)."""
    if isinstance(node, Mapping):
        return {_plain(key): _plain(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_plain(value) for value in node]
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


def _problems(path: Path, document: CommentedMap, details: ErrorDetails) -> list[PlaybookProblem]:
    """Return what one of pydantic's errors says; what is wrong in a file of slots stands there."""
    cause = details.get("ctx", {}).get("error")
    if isinstance(cause, SlotFileError):
        return [PlaybookProblem(cause.path, problem.line, 1, problem.message) for problem in cause.problems]
    return [_problem(path, document, details)]


def _problem(path: Path, document: CommentedMap, details: ErrorDetails) -> PlaybookProblem:
    location = [part for part in details["loc"] if part not in _NOT_IN_THE_FILE]
    line, column = _position(document, location)
    where = ".".join(map(str, location)) or "playbook"
    message = details["msg"].removeprefix("Value error, ")
    if details["type"] == "extra_forbidden":
        message = f"unknown key{_suggestion(str(location[-1]), _allowed_keys(details['loc'][:-1]))}"
    elif details["type"] == "missing":
        message = "is missing"
    elif not isinstance(details["input"], dict | list):
        message += f", found {details['input']!r}"
    return PlaybookProblem(path, line, column, f"{where}: {message}")


def _position(document: CommentedMap, location: Sequence[int | str]) -> tuple[int, int]:
    """Return line and column of the deepest part of a location that stands in the file, counted from 1."""
    node: Any = document
    line, column = 0, 0
    for part in location:
        if isinstance(node, CommentedMap) and part in node:
            line, column = node.lc.key(part)
        elif isinstance(node, CommentedSeq) and isinstance(part, int) and part < len(node):
            line, column = node.lc.item(part)
        else:
            break
        node = node[part]
    return line + 1, column + 1


def _allowed_keys(location: Sequence[int | str]) -> list[str]:
    """Return the keys the schema knows at a location."""
    model: Any = Playbook
    for part in location:
        model = _section_at(model, part)
    return sorted(model.model_fields) if _is_section(model) else []


def _section_at(model: Any, part: int | str) -> Any:
    """Return the type of what stands under one part of a location, or None where the schema ends."""
    if _is_section(model):
        return model.model_fields[part].annotation if part in model.model_fields else None
    for arm in (model, *get_args(model)):
        if get_origin(arm) is dict:  # the keys are the user's own names
            return get_args(arm)[1]
        if _is_section(arm) and "kind" in arm.model_fields and part in get_args(arm.model_fields["kind"].annotation):
            return arm
    return None


def _is_section(model: Any) -> bool:
    return isinstance(model, type) and issubclass(model, BaseModel)


def _suggestion(found: str, allowed: Sequence[str]) -> str:
    if not allowed:
        return ""
    nearest = difflib.get_close_matches(found, allowed, n=1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    return f"{hint} (allowed are {', '.join(allowed)})"
