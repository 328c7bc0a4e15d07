"""Reads playbooks: every problem of a file at once, each with file:line:column, what was found and what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError

from gcs.errors import ServiceError
from gcs.playbook.formation import KINDS
from gcs.playbook.matrix import MatrixRun, changed, combinations, matrix_problems, single_values
from gcs.playbook.schema import Playbook, Site
from gcs.playbook.slot_files.slots import SlotFileError, Surroundings
from gcs.playbook.suggestions import REFUSED, Location, Problem, suggestion
from planner.frames import FormationFrame, GeodeticPosition

_LARGEST_FILE_BYTES = 500_000
_MOST_VALUES = 100_000
"""So many, with what aliases repeat, are a trap and no playbook."""
_LONGEST_SHOWN = 80
_NO_FORMATION = ("union_tag_invalid", "union_tag_not_found")
"""What pydantic calls a formation whose kind there is not."""


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
    """Return the playbook in a YAML file, without regard to its matrix; PlaybookError with every problem it has."""
    return _load(path)[0]


def load_runs(path: Path) -> tuple[MatrixRun, ...]:
    """Return every run of the playbook in a YAML file, one without a matrix; PlaybookError with every problem."""
    return _load(path)[1]


def _load(path: Path) -> tuple[Playbook, tuple[MatrixRun, ...]]:
    document = _read_yaml(path)
    plain = _plain_document(path, document)
    playbook, errors = _validated(plain, path.parent)
    problems = [problem for details in errors for problem in _problems(path, document, details)]
    runs = [MatrixRun({}, playbook)] if playbook is not None and not playbook.matrix else []
    if plain.get("matrix") and not any(details["loc"][:1] == ("matrix",) for details in errors):
        known = {_words(details) for details in errors}
        for place, words in _matrix_problems(plain, path.parent, known, runs):
            problems.append(PlaybookProblem(path, *_position(document, place), f"{'.'.join(map(str, place))}: {words}"))
    if playbook is None or problems:
        raise PlaybookError(problems)
    return playbook, tuple(runs)


def _matrix_problems(
    plain: dict[str, Any], folder: Path, known: Collection[str], runs: list[MatrixRun]
) -> Iterator[Problem]:
    """Yield what is wrong with the runs of a matrix that is not `known` already; collect those with nothing wrong."""
    found = list(matrix_problems(plain))
    said: dict[str, Location] = dict.fromkeys(known, ())
    for place, values in [] if found else single_values(plain):
        errors = _validated(changed(plain, values), folder)[1]
        found += [(place, words) for words in map(_words, errors) if said.setdefault(words, place) is place]
    yield from found
    for values in [] if found or known else combinations(plain):
        playbook, errors = _validated(changed(plain, values), folder)
        if playbook is not None:
            runs.append(MatrixRun(values, playbook))
        yield from ((("matrix",), f"with {values}: {_words(details)}") for details in errors)


def _validated(plain: Any, folder: Path) -> tuple[Playbook | None, list[ErrorDetails]]:
    """Return the playbook, or else what pydantic has against it."""
    try:
        return Playbook.model_validate(plain, context=Surroundings(folder, _site(plain))), []
    except ValidationError as error:
        return None, error.errors()


def _site(plain: Mapping[str, Any]) -> tuple[GeodeticPosition, FormationFrame] | None:
    """Return where the playbook's formation stands; None when that is not right, which validation then says."""
    try:
        site = Site.model_validate(plain.get("site", {}))
    except ValidationError:
        return None
    return site.origin, site.frame


def _read_yaml(path: Path) -> CommentedMap:
    try:
        with path.open("rb") as file:
            text = file.read(_LARGEST_FILE_BYTES + 1)
        if len(text) > _LARGEST_FILE_BYTES:
            raise PlaybookError([PlaybookProblem(path, 1, 1, "is too large to be a playbook (over 500 kB)")])
        document = YAML(typ="rt").load(text.decode("utf-8"))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise PlaybookError([PlaybookProblem(path, line, column, f"is not YAML: {error.problem}")]) from error
    except PlaybookError:
        raise
    except Exception as error:  # a file made to do harm makes its reader raise anything
        raise PlaybookError([PlaybookProblem(path, 1, 1, f"cannot be read: {error}")]) from error
    if not isinstance(document, CommentedMap):
        raise PlaybookError([PlaybookProblem(path, 1, 1, "is not a mapping of playbook sections")])
    return document


def _plain_document(path: Path, document: CommentedMap) -> dict[str, Any]:
    try:
        plain: dict[str, Any] = _plain(document, iter(range(_MOST_VALUES)))
    except (ValueError, TypeError, RecursionError) as error:
        raise PlaybookError([PlaybookProblem(path, 1, 1, f"is no playbook: {error}")]) from error
    return plain


def _plain(node: Any, left: Iterator[int]) -> Any:
    """Return the node as plain dicts, lists and scalars (ruamel's own scalar classes would fail strict checks).

    ValueError when there are more of them than are `left`, or one is no text; TypeError when something cannot be a key.
    """
    if next(left, None) is None:
        raise ValueError(f"it says more than {_MOST_VALUES} values, with those that its aliases repeat")
    if isinstance(node, Mapping):
        return {_plain(key, left): _plain(value, left) for key, value in node.items()}
    if isinstance(node, list):
        return [_plain(value, left) for value in node]
    if isinstance(node, str) and not _is_text(node):
        raise ValueError(f"{node[:40]!a} is not text: half a character, as \\ud800 is, cannot be written")
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


def _is_text(found: str) -> bool:
    try:
        found.encode()
    except UnicodeEncodeError:
        return False
    return True


def _problems(path: Path, document: CommentedMap, details: ErrorDetails) -> list[PlaybookProblem]:
    """Return what one of pydantic's errors says; what is wrong in a file of slots stands there."""
    cause = details.get("ctx", {}).get("error")
    if isinstance(cause, SlotFileError):
        return [PlaybookProblem(cause.path, problem.line, 1, problem.message) for problem in cause.problems]
    return [_problem(path, document, details)]


def _problem(path: Path, document: CommentedMap, details: ErrorDetails) -> PlaybookProblem:
    return PlaybookProblem(path, *_position(document, _keys(details)), _words(details))


def _keys(details: ErrorDetails) -> list[int | str]:
    """Return where one of pydantic's errors is, without what is no key: which formation it took, for one."""
    location = details["loc"]
    if details["type"] in _NO_FORMATION:
        return [*location, "kind"]
    kind = 1 if location[:1] == ("formation",) and location[1:2] and location[1] in KINDS else None
    return [part for number, part in enumerate(location) if number != kind and part != "[key]"]


def _words(details: ErrorDetails) -> str:
    """Return where one of pydantic's errors is, and what it says."""
    location, found = _keys(details), details["input"]
    message = details["msg"].removeprefix("Value error, ")
    if details["type"] == "extra_forbidden":
        message = f"unknown key{suggestion(str(location[-1]), _allowed_keys(details['loc'][:-1]))}"
    elif details["type"] == "missing":
        message = "is missing"
    elif details["type"] in _NO_FORMATION:
        message = f"is no formation{suggestion(str(found.get('kind', '')), KINDS)}, found {found.get('kind')!r}"
    elif details["type"] != REFUSED and not isinstance(found, dict | list):
        message += f", found {_shown(found)}"
    return f"{'.'.join(map(str, location)) or 'playbook'}: {message}"


def _shown(found: Any) -> str:
    """Return a value as it is shown: Python writes no number of thousands of digits, and nobody reads one."""
    try:
        text = repr(found)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def _position(document: CommentedMap, location: Sequence[int | str]) -> tuple[int, int]:
    """Return line and column of the deepest part of a location that stands in the file, counted from 1."""
    node: Any = document
    line, column = 0, 0
    for part in location:
        known = isinstance(node, CommentedMap) and part in node
        if not known and not (isinstance(node, CommentedSeq) and isinstance(part, int) and part < len(node)):
            break
        places = node.lc.data or {}  # what was merged into a mapping has no place of its own
        line, column = places[part][:2] if part in places else (line, column)
        node = node[part]
    return line + 1, column + 1


def _allowed_keys(location: Sequence[int | str]) -> list[str]:
    """Return the keys the schema knows at a location."""
    model: Any = Playbook
    for part in location:
        model = _section_at(model, part)
    return [key for arm in _arms(model) if _is_section(arm) for key in sorted(_fields(arm))]


def _section_at(model: Any, part: int | str) -> Any:
    """Return the type of what stands under one part of a location, or None where the schema ends."""
    for arm in _arms(model):
        if get_origin(arm) is dict:  # the keys are the user's own names
            return get_args(arm)[1]
        if get_origin(arm) is list:
            return get_args(arm)[0]
        if not _is_section(arm):
            continue
        if "kind" in arm.model_fields and part in get_args(arm.model_fields["kind"].annotation):
            return arm
        if isinstance(part, str) and part in _fields(arm):
            return _fields(arm)[part]
    return None


def _arms(model: Any) -> Iterator[Any]:
    """Yield what a type may be: itself, or each arm of a union, without annotations."""
    if get_origin(model) is Annotated:
        yield from _arms(get_args(model)[0])
    elif get_origin(model) in (Union, UnionType):
        for arm in get_args(model):
            yield from _arms(arm)
    else:
        yield model


def _fields(section: type[BaseModel]) -> dict[str, Any]:
    return {field.alias or name: field.annotation for name, field in section.model_fields.items()}


def _is_section(model: Any) -> bool:
    return isinstance(model, type) and issubclass(model, BaseModel)
