"""Conditions: each way to write one means what it says, at its ends too, and everything else is refused in words."""

from __future__ import annotations

import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from gcs.expectations.condition import Condition, Value, is_number, parse_condition


@pytest.mark.parametrize(
    ("written", "met", "missed"),
    [
        ("< 1.0", [0.999, -5, 0], [1.0, 2]),
        ("<= 3", [3, 3.0, 2.9], [3.001]),
        ("> 1", [1.001], [1, 1.0]),
        (">=5", [5, 6], [4.999]),
        ("== 8", [8, 8.0], [7, "8", True]),
        (8, [8, 8.0], [8.1, "8"]),
        ("!= 8", [7], [8, "7"]),
        ("1.0 .. 2.0", [1, 1.5, 2], [0.99, 2.01]),
        ("1..2", [1.5], [0]),
        ("-2 .. -1", [-1.5], [0]),
        ("formed", ["formed"], ["Formed", "aborted", True]),
        ("== formed", ["formed"], ["aborted"]),
        ("!= formed", ["aborted"], ["formed", 3]),
        ("~ Bearing report", ["no bearing report from its sensor"], ["bearing", 3]),
        (True, [True], [False, 1, "true"]),
        ("false", [False], [True, 0]),
        ("1e3", [1000], [1]),
        ("<= 10", [10**400 * -1, 10], [10**400]),
    ],
)
def test_what_is_met_and_what_is_not(written: object, met: list[Value], missed: list[Value]) -> None:
    condition = parse_condition(written)
    assert [condition.holds(value) for value in met] == [True] * len(met)
    assert [condition.holds(value) for value in missed] == [False] * len(missed)


@pytest.mark.parametrize("written", ["< 1", "!= 1", "== 1", "0 .. 2", "~ x", "!= x", True])
def test_what_was_not_measured_meets_nothing(written: object) -> None:
    assert not parse_condition(written).holds(None)
    assert not parse_condition(written).holds(float("nan"))


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("", "a condition is"),
        ("  ", "a condition is"),
        (None, "a condition is"),
        ([1], "a condition is"),
        ({"<": 1}, "a condition is"),
        (float("inf"), "a condition is"),
        ("9" * 400, "a condition is"),
        ("x" * 300, "a condition is"),
        ("<", "needs a value behind it"),
        ("~ ", "needs a value behind it"),
        ("< one", "'one' is no number: '<' compares numbers"),
        ("> true", "compares numbers"),
        ("<< 1", "'< 1' is no number"),
        ("== inf", "no finite number"),
        ("nan", "no finite number"),
        ("2 .. 1", "the lower end of a range comes first"),
        ("a .. b", "between two numbers"),
        ("1 .. inf", "no finite number"),
    ],
)
def test_what_is_no_condition_says_what_is_allowed(written: object, expected: str) -> None:
    with pytest.raises(ValueError, match=expected.replace(".", r"\.")):
        parse_condition(written)


@given(st.text(max_size=30) | st.floats() | st.integers() | st.booleans() | st.none())
def test_a_condition_written_out_is_read_as_the_same(written: object) -> None:
    try:
        condition = parse_condition(written)
    except ValueError:
        reject()
    assert parse_condition(str(condition)) == condition


@given(low=st.floats(-1e6, 1e6), high=st.floats(-1e6, 1e6), measured=st.floats(-1e6, 1e6))
def test_conditions_of_numbers_agree_with_arithmetic(low: float, high: float, measured: float) -> None:
    low, high = sorted((low, high))
    assert parse_condition(f"{low!r} .. {high!r}").holds(measured) == (low <= measured <= high)
    for sign, meets in (("<", measured < low), ("<=", measured <= low), (">", measured > low), (">=", measured >= low)):
        assert parse_condition(f"{sign} {low!r}").holds(measured) == meets
    assert parse_condition(low) == Condition("==", low)
    assert is_number(low)
