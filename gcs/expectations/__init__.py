"""Expectations: what a playbook says must come true of a flight, and whether it did."""

from gcs.expectations.condition import Condition, parse_condition
from gcs.expectations.figures import FIGURES, measured
from gcs.expectations.junit import STOPPED, Suite, suite_of, write_junit
from gcs.expectations.mapping import Expectations, require_known
from gcs.expectations.verdicts import Verdict, all_passed, judge, verdicts_of

__all__ = [
    "FIGURES",
    "STOPPED",
    "Condition",
    "Expectations",
    "Suite",
    "Verdict",
    "all_passed",
    "judge",
    "measured",
    "parse_condition",
    "require_known",
    "suite_of",
    "verdicts_of",
    "write_junit",
]
