"""What many simulated relays say together: the documented JSON summary, and a row for each receiver of each run."""

from __future__ import annotations

import csv
import importlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gcs.errors import ServiceError
from gcs.simulate.outcome import ReceiverResult, RunResult

COLUMNS = ("seed", "outcome", *ReceiverResult.__struct_fields__)


def summary(results: Sequence[RunResult]) -> dict[str, Any]:
    """Return the summary of runs: metres, seconds; null for what no run has."""
    separations_m = [run.min_separation_m for run in results if run.min_separation_m is not None]
    return {
        "runs": len(results),
        "formed": sum(run.outcome == "formed" for run in results),
        "placement_error_m": _of_receivers(results, lambda receiver: receiver.placement_error_m),
        "stop_error_m": _of_receivers(results, lambda receiver: receiver.stop_error_m),
        "duration_s": distribution(run.duration_s for run in results),
        "min_separation_m": min(separations_m, default=None),
        "emission_transmitter_s": distribution(run.emission_transmitter_s for run in results),
        "hover_error_m": _of_receivers(results, lambda receiver: receiver.hover_error_m),
        "overshoot_m": _of_receivers(results, lambda receiver: receiver.overshoot_m),
        "flown_length_m": distribution(run.flown_length_m for run in results),
        "outcomes": dict(Counter(run.outcome for run in results)),
        "reasons": dict(Counter(run.reason for run in results if run.reason)),
        "by_receiver": {name: _by_receiver(of_one) for name, of_one in _grouped(results).items()},
    }


def distribution(values: Iterable[float | None]) -> dict[str, float | None]:
    """Return median, 95th percentile and largest of the sizes of values, leaving out None."""
    sizes = [abs(value) for value in values if value is not None]
    if not sizes:
        return {"p50": None, "p95": None, "max": None}
    return {"p50": float(np.percentile(sizes, 50)), "p95": float(np.percentile(sizes, 95)), "max": max(sizes)}


def placement_errors_m(results: Sequence[RunResult]) -> dict[str, list[float]]:
    """Return the placement errors of each receiver, in the order of the runs."""
    return {
        name: [receiver.placement_error_m for receiver in of_one if receiver.placement_error_m is not None]
        for name, of_one in _grouped(results).items()
    }


def write_rows(results: Sequence[RunResult], path: Path) -> None:
    """Write a row for each receiver of each run: CSV, or Parquet where the suffix says so. ServiceError when not."""
    rows = [
        {"seed": run.seed, "outcome": run.outcome, **msgspec.structs.asdict(receiver)}
        for run in results
        for receiver in run.receivers
    ]
    try:
        if path.suffix.lower() == ".parquet":
            _write_parquet(rows, path)
        else:
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, COLUMNS)
                writer.writeheader()
                writer.writerows(rows)
    except OSError as error:
        raise ServiceError(f"{path} cannot be written: {error.strerror or error}") from error


def require_writable(path: Path) -> None:
    """Return when rows can be written in the format of a path; ServiceError when what it takes is not installed."""
    if path.suffix.lower() == ".parquet":
        _pyarrow("pyarrow")


def _write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    kinds = {"seed": arrow.int64(), **dict.fromkeys(("outcome", "name", "slot", "state", "reason"), arrow.string())}
    schema = arrow.schema([(name, kinds.get(name, arrow.float64())) for name in COLUMNS])
    parquet.write_table(arrow.Table.from_pylist(rows, schema=schema), path)


def _pyarrow(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ServiceError("Parquet takes pyarrow: pip install 'bearing-relay[study]', or write a .csv") from error


def _grouped(results: Sequence[RunResult]) -> dict[str, list[ReceiverResult]]:
    grouped: dict[str, list[ReceiverResult]] = {}
    for run in results:
        for receiver in run.receivers:
            grouped.setdefault(receiver.name, []).append(receiver)
    return grouped


def _of_receivers(
    results: Sequence[RunResult], value: Callable[[ReceiverResult], float | None]
) -> dict[str, float | None]:
    return distribution(value(receiver) for run in results for receiver in run.receivers)


def _by_receiver(of_one: Sequence[ReceiverResult]) -> dict[str, Any]:
    return {
        "slot": of_one[0].slot,
        "placed": sum(receiver.placement_error_m is not None for receiver in of_one),
        "predicted_3sigma_m": of_one[0].predicted_3sigma_m,
        "placement_error_m": distribution(receiver.placement_error_m for receiver in of_one),
        "stop_error_m": distribution(receiver.stop_error_m for receiver in of_one),
        "duration_s": distribution(receiver.duration_s for receiver in of_one),
    }
