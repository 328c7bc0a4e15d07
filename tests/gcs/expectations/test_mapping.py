"""`expect:` as a playbook's schema reads it: everything wrong is said at once, at its figure."""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from gcs.expectations import FIGURES, Condition, Expectations, require_known


class Stage(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    expect: Expectations = {}


class Book(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    stages: list[Stage]

    @model_validator(mode="after")
    def _known(self) -> Book:
        clauses = [(("stages", number, "expect"), stage.expect) for number, stage in enumerate(self.stages)]
        require_known(clauses, ["U1", "U2"], ["relay"])
        return self


def problems(expect: Any) -> list[tuple[tuple[int | str, ...], str]]:
    with pytest.raises(ValidationError) as caught:
        Book.model_validate({"stages": [{}, {"expect": expect}]})
    return [(details["loc"], details["msg"]) for details in caught.value.errors()]


def test_figures_with_conditions_of_every_kind() -> None:
    written = {"placement_error_m.U1": "< 1", "receivers_placed": 8, "outcome": "formed", "held_reason": "~ sensor"}
    read = Stage.model_validate({"expect": written})
    assert read.expect["receivers_placed"] == Condition("==", 8)
    assert list(read.expect) == list(written)
    for mode in ("json", "python"):
        assert Stage.model_validate(read.model_dump(mode=mode)) == read
    assert Stage().expect == {}


@pytest.mark.parametrize(
    ("name", "written", "expected"),
    [
        ("placment_error_m", "< 1", "unknown figure; did you mean 'placement_error_m'? (allowed are outcome, "),
        ("", 1, "unknown figure (allowed are "),
        (4, 1, "a figure has a name, not 4"),
        ("placement_error_m", "< one", "'one' is no number"),
        ("placement_error_m", "formed", "placement_error_m is a number (how far from its slot"),
        ("placement_error_m", True, "placement_error_m is a number"),
        ("placement_error_m", "~ 1", "placement_error_m is a number"),
        ("placement_error_m.", "< 1", "behind the dot belongs one of max, "),
        ("duration_s.U1", "< 1", "duration_s is one value of the whole run: leave out '.U1'"),
        ("outcome", "< 3", "outcome is a text"),
        ("outcome", "1 .. 2", "outcome is a text"),
        ("outcome", "!= fromed", "outcome is one of formed, completed, aborted, failed"),
        ("outcome", None, 'a condition is "< 1"'),
    ],
)
def test_each_problem_at_its_figure(name: object, written: object, expected: str) -> None:
    [(location, message)] = problems({name: written})
    assert location == ("stages", 1, "expect", name)
    assert message.startswith(expected)


def test_everything_wrong_is_said_at_once() -> None:
    found = problems({"outcome": 3, "duration_s": "< 5", "min_separation": "> 5", "emission_transmitter_s": "<"})
    assert [location[-1] for location, _ in found] == ["outcome", "min_separation", "emission_transmitter_s"]


@pytest.mark.parametrize("written", [["outcome"], "formed", 3, None])
def test_what_is_no_mapping(written: object) -> None:
    [(location, message)] = problems(written)
    assert location == ("stages", 1, "expect")
    assert "a mapping from figures to conditions" in message


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("placement_error_m.U7", "'U7' is no receiver here (allowed are U1, U2, max, min, sum, mean, median, p95)"),
        ("stage_duration_s.land", "'land' is no stage here (allowed are relay, max, "),
        ("bearings_refused.tired", "'tired' is no problem here (allowed are stale, "),
    ],
)
def test_nobody_who_is_not_in_the_playbook_is_asked(written: str, expected: str) -> None:
    [(location, message)] = problems({written: "< 1", "placement_error_m.U2": "< 1", "link_lost_share.any": "< 1"})
    assert location == ("stages", 1, "expect", written)
    assert message.startswith(expected)


def test_editors_complete_figures_and_refuse_others() -> None:
    schema = Book.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    good = {"stages": [{"expect": {"placement_error_m.p95": "< 1", "outcome": "formed", "receivers_placed": 8}}]}
    jsonschema.validate(good, schema)
    for bad in ({"nothing": 1}, {"outcome.U1": "x"}, {"outcome": [1]}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({"stages": [{"expect": bad}]}, schema)
    described = schema["$defs"]["Stage"]["properties"]["expect"]["properties"]
    assert described.keys() == FIGURES.keys()
    assert all(each["description"] for each in described.values())
