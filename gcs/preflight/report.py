"""What a preflight comes to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.checks import Check, Verdict
from gcs.errors import ServiceError


class PreflightError(ServiceError):
    """Something is wrong that nothing may be armed with; `failures` is all of it."""

    def __init__(self, failures: tuple[Check, ...]) -> None:
        self.failures = failures
        super().__init__("\n".join(["nothing was armed:", *_lines(failures)]))


def alike(checks: Iterable[Check]) -> list[tuple[list[str], Check]]:
    """Return each thing found, with the names of all vehicles it was found of, and the check of the first."""
    groups: dict[Check, list[Check]] = {}
    for check in checks:
        groups.setdefault(replace(check, vehicle="", link=""), []).append(check)
    return [([check.vehicle for check in group], group[0]) for group in groups.values()]


def _lines(checks: Iterable[Check]) -> list[str]:
    return [
        f"{_who(names, check)}: {check.name}: {check.found}. {check.way_out}".rstrip() for names, check in alike(checks)
    ]


def _who(names: list[str], check: Check) -> str:
    """Return whom a check is about: one vehicle with its link, or several by name."""
    return f"{check.vehicle} on {check.link}" if len(names) == 1 and check.link else ", ".join(names)


@dataclass(frozen=True)
class PreflightReport:
    """Every check of every vehicle, and the strategy that flies each one that can be flown."""

    checks: tuple[Check, ...]
    autopilots: Mapping[str, Autopilot]

    def having(self, verdict: Verdict) -> tuple[Check, ...]:
        """Return the checks with a verdict."""
        return tuple(check for check in self.checks if check.verdict is verdict)

    def lines(self, verdict: Verdict) -> list[str]:
        """Return the checks with a verdict in words, those that found the same of several vehicles in one line."""
        return _lines(self.having(verdict))

    @property
    def may_arm(self) -> bool:
        """Whether there is no hard failure."""
        return not self.having(Verdict.HARD)

    def require(self) -> None:
        """Return when everything may be armed; PreflightError with every hard failure otherwise."""
        if not self.may_arm:
            raise PreflightError(self.having(Verdict.HARD))

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {
            "may_arm": self.may_arm,
            "checks": [{**asdict(check), "verdict": check.verdict.value} for check in self.checks],
        }
