"""`expect:` in a playbook: a mapping from figures to conditions, read with everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, get_args

from pydantic import PlainSerializer, PlainValidator, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from gcs.expectations.condition import ALLOWED, Condition, is_number, parse_condition
from gcs.expectations.figures import FIGURES, SUMMARIES, Figure, PartedFigure, find_figure
from gcs.report_checks import Problem


def _read(value: Any) -> dict[str, Condition]:
    if not isinstance(value, Mapping):
        raise ValueError("expectations are a mapping from figures to conditions, as placement_error_m: '< 1.0'")
    read: dict[str, Condition] = {}
    problems: list[InitErrorDetails] = []
    for name, written in value.items():
        try:
            read[name] = _read_one(name, written)
        except ValueError as error:
            problems.append(_problem((name if isinstance(name, int) else str(name),), str(error), written))
    if problems:
        raise ValidationError.from_exception_data("expectations", problems)
    return read


def _read_one(name: object, written: object) -> Condition:
    if not isinstance(name, str):
        raise ValueError(f"a figure has a name, not {name!r}")
    figure, _ = find_figure(name)
    condition = written if isinstance(written, Condition) else parse_condition(written)
    _require_kind(figure, condition)
    return condition


def _require_kind(figure: Figure | PartedFigure, condition: Condition) -> None:
    if figure.kind == "number":
        if not is_number(condition.value) or condition.operator == "~":
            raise ValueError(f"{figure.name} is a number ({figure.meaning}): '{condition}' cannot be said of it")
        return
    if not isinstance(condition.value, str) or condition.operator not in ("==", "!=", "~"):
        raise ValueError(f"{figure.name} is a text ({figure.meaning}): '{condition}' cannot be said of it")
    choices = figure.choices if isinstance(figure, Figure) else ()
    if choices and condition.operator != "~" and condition.value not in choices:
        raise ValueError(f"{figure.name} is one of {', '.join(choices)}")


def _write(expectations: Mapping[str, Condition]) -> dict[str, str]:
    return {name: str(condition) for name, condition in expectations.items()}


def require_known(
    clauses: Iterable[tuple[Sequence[str | int], Mapping[str, Condition]]],
    receivers: Collection[str],
    stages: Collection[str],
) -> None:
    """Check that figures are asked of nobody who is not in the playbook, in every clause at its location.

    Raises pydantic's ValidationError with each one that is, at its place: a validator lets it through.
    """
    problems = [
        _problem((*location, written), wrong, str(clause[written]))
        for location, clause in clauses
        for written, wrong in _strangers(clause, receivers, stages)
    ]
    if problems:
        raise ValidationError.from_exception_data("expectations", problems)


def _strangers(clause: Iterable[str], receivers: Collection[str], stages: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield each figure that is asked of nobody, as written, and what is wrong with it."""
    for written in clause:
        figure, selector = find_figure(written)
        if not selector or selector in SUMMARIES or not isinstance(figure, PartedFigure):
            continue
        known = {"receiver": receivers, "stage": stages, "problem": get_args(Problem)}.get(figure.of)
        if known is not None and selector not in known:
            yield written, f"{selector!r} is no {figure.of} here (allowed are {', '.join([*known, *SUMMARIES])})"


def _problem(location: tuple[str | int, ...], message: str, found: object) -> InitErrorDetails:
    kind = PydanticCustomError("expectation", "{message}", {"message": message})
    return InitErrorDetails(type=kind, loc=location, input=found)


_CONDITION_SCHEMA: Final = {"description": f"a condition: {ALLOWED}", "type": ["number", "string", "boolean"]}
_PARTED: Final = [name for name, figure in FIGURES.items() if isinstance(figure, PartedFigure)]

Expectations = Annotated[
    dict[str, Condition],
    PlainValidator(_read),
    PlainSerializer(_write),
    WithJsonSchema(
        {
            "description": "what has to come true: each figure with its condition",
            "type": "object",
            "properties": {
                name: {**_CONDITION_SCHEMA, "description": figure.meaning} for name, figure in FIGURES.items()
            },
            "patternProperties": {rf"^({'|'.join(_PARTED)})\..+$": _CONDITION_SCHEMA},
            "additionalProperties": False,
        }
    ),
]
"""The type of an `expect` clause in a playbook's schema: figures as written, each with its condition."""
