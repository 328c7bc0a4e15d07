"""A condition that one measured figure has to meet: "< 1.0", ">= 5", "1.0 .. 2.0", "~ no bearing", or a bare value."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeGuard, cast

Value = float | str | bool
"""What is measured, and what it is compared with."""

Operator = Literal["<", "<=", ">", ">=", "==", "!=", "~", ".."]

ALLOWED: Final = (
    '"< 1", "<= 1", "> 1", ">= 1", "== 1", "!= 1", "1 .. 2", "~ part of a text", or a bare value it must equal'
)

_COMPARED: Final[dict[str, Callable[[float, float], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_WRITTEN: Final = re.compile(r"(?P<operator><=|>=|==|!=|<|>|~)\s*(?P<operand>.*)", re.DOTALL)
_RANGE: Final = re.compile(r"(?P<low>\S+)\s*\.\.\s*(?P<high>\S+)")
_WHOLE: Final = re.compile(r"[+-]?[0-9]+")
_FLAGS: Final = {"true": True, "false": False}
_LONGEST: Final = 200


@dataclass(frozen=True)
class Condition:
    """A measured value is compared with `value`; for ".." it is to lie between that and `upper`, ends included."""

    operator: Operator
    value: Value
    upper: float | None = None

    def holds(self, measured: Value | None) -> bool:
        """Return whether the measured value meets this. What was not measured, or is of another kind, never does."""
        if self.operator == "~":
            return isinstance(measured, str) and str(self.value).casefold() in measured.casefold()
        if self.operator in ("==", "!="):
            return _alike(measured, self.value) and (measured == self.value) == (self.operator == "==")
        if not is_number(measured) or not is_number(self.value):
            return False
        if self.operator == "..":
            return self.upper is not None and self.value <= measured <= self.upper
        return _COMPARED[self.operator](measured, self.value)

    def __str__(self) -> str:
        """Return it as it may be written in a playbook."""
        if self.upper is not None:
            return f"{_text(self.value)} .. {_text(self.upper)}"
        return f"{self.operator} {_text(self.value)}"


def parse_condition(written: object) -> Condition:
    """Return the condition written in a playbook: a text, number or truth value. ValueError with what is allowed."""
    if isinstance(written, bool) or is_number(written):
        return Condition("==", written)
    if not isinstance(written, str) or not written.strip() or len(written) > _LONGEST:
        raise ValueError(f"a condition is {ALLOWED}")
    text = written.strip()
    if (found := _WRITTEN.fullmatch(text)) is not None:
        return _compared(found["operator"], found["operand"].strip())
    if (found := _RANGE.fullmatch(text)) is not None:
        return _between(found["low"], found["high"])
    return Condition("==", _value(text))


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -math.inf < value < math.inf


def _compared(sign: str, operand: str) -> Condition:
    if not operand:
        raise ValueError(f"{sign!r} needs a value behind it: a condition is {ALLOWED}")
    value: Value = operand if sign == "~" else _value(operand)
    if sign in _COMPARED and not is_number(value):
        raise ValueError(f"{operand!r} is no number: {sign!r} compares numbers")
    return Condition(cast(Operator, sign), value)


def _between(low: str, high: str) -> Condition:
    value, upper = _value(low), _value(high)
    if not is_number(value) or not is_number(upper):
        raise ValueError(f"{low} .. {high}: a range is between two numbers, as 1.0 .. 2.0")
    if value > upper:
        raise ValueError(f"{low} .. {high}: the lower end of a range comes first")
    return Condition("..", value, upper)


def _value(text: str) -> Value:
    """Return a number where the text is one, a truth value, or the text itself."""
    if text.casefold() in _FLAGS:
        return _FLAGS[text.casefold()]
    try:
        number = float(text)
    except ValueError:
        return text
    if not math.isfinite(number):
        raise ValueError(f"{text} is no finite number")
    return int(text) if _WHOLE.fullmatch(text) else number


def _alike(measured: Value | None, value: Value) -> bool:
    """Return whether two values are of one kind: a truth value is no number, and NaN is nothing."""
    if is_number(value):
        return is_number(measured)
    return type(measured) is type(value)


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, int | float) else value
