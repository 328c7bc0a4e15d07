"""A study keeps what is done, goes on where it was left, and says what many runs say together."""

from __future__ import annotations

import csv
import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from gcs.errors import ServiceError
from gcs.simulate.outcome import ReceiverResult, RunResult
from gcs.simulate.pictures import draw_placement_errors
from gcs.simulate.study import Study, StudyFolder, dask_pool, fly_study
from gcs.simulate.summary import COLUMNS, distribution, placement_errors_m, summary, write_rows
from tests.gcs.simulate.small import small


@pytest.fixture
def study(tmp_path: Path) -> Study:
    playbook = small(tmp_path)
    return Study(playbook, playbook.plan())


def a_run(seed: int, error_m: float | None = 0.1, stop_error_m: float | None = -0.2) -> RunResult:
    placed = error_m is not None
    receiver = ReceiverResult(
        "U1", "O1", "PLACED" if placed else "HELD", "" if placed else "silent", 50.0, 51.0, 0.4, error_m, error_m,
        stop_error_m if placed else None, 0.05 if placed else None, 20.0 if placed else None,
    )  # fmt: skip
    return RunResult(
        seed, "formed" if placed else "held", "" if placed else "silent", 30.0 + seed, 60.0, 10.0 + seed, [receiver]
    )


def fly(study: Study, folder: StudyFolder, seeds: range) -> list[int]:
    flown: list[int] = []
    with ThreadPoolExecutor(1) as pool:
        fly_study(study, seeds, folder, pool, 1, lambda run: flown.append(run.seed))
    return flown


def test_what_is_done_is_kept_and_not_flown_again(study: Study, tmp_path: Path) -> None:
    folder = StudyFolder.create(tmp_path / "study", study)
    assert fly(study, folder, range(1, 3)) == [1, 2]
    before = folder.results()
    again = StudyFolder.resume(tmp_path / "study", study)
    assert fly(study, again, range(1, 5)) == [3, 4]
    assert again.results()[:2] == before
    assert [run.seed for run in again.results()] == [1, 2, 3, 4]
    assert all(run.outcome == "formed" for run in again.results())


def test_a_line_cut_off_by_a_crash_is_flown_again(study: Study, tmp_path: Path) -> None:
    folder = StudyFolder.create(tmp_path / "study", study)
    whole = msgspec.json.encode(a_run(1)) + b"\n"
    (folder.path / "runs.jsonl").write_bytes(whole + msgspec.json.encode(a_run(2))[:40])
    assert [run.seed for run in folder.results()] == [1]
    with folder.appending() as append:
        append(a_run(3))
    assert (folder.path / "runs.jsonl").read_bytes() == whole + msgspec.json.encode(a_run(3)) + b"\n"


def test_an_interrupt_leaves_what_is_done(study: Study, tmp_path: Path) -> None:
    folder = StudyFolder.create(tmp_path / "study", study)

    def interrupt(run: RunResult) -> None:
        raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        fly_study(study, range(1, 100), folder, pool, 1, interrupt)
    assert [run.seed for run in folder.results()] == [1]


def test_a_study_of_something_else_is_not_gone_on_with(study: Study, tmp_path: Path) -> None:
    StudyFolder.create(tmp_path / "study", study)
    other = small(tmp_path, "sensor: {sigma_deg: 0.7}\n")
    with pytest.raises(ServiceError, match="study of another playbook"):
        StudyFolder.resume(tmp_path / "study", Study(other, other.plan()))
    with pytest.raises(ServiceError, match=r"of other options \(study.json differs\)"):
        StudyFolder.resume(tmp_path / "study", replace(study, stop="raw"))
    with pytest.raises(ServiceError, match="no study to resume"):
        StudyFolder.resume(tmp_path / "nowhere", study)
    with pytest.raises(ServiceError, match="exists: go on"):
        StudyFolder.create(tmp_path / "study", study)


def test_a_line_that_is_no_run_is_named(study: Study, tmp_path: Path) -> None:
    folder = StudyFolder.create(tmp_path / "study", study)
    (folder.path / "runs.jsonl").write_bytes(msgspec.json.encode(a_run(1)) + b'\n{"seed": 2}\n')
    with pytest.raises(ServiceError, match=r"runs.jsonl:2: no run of a study"):
        folder.results()


def test_the_summary_is_what_the_runs_say() -> None:
    runs = [a_run(1, 0.1), a_run(2, 0.3), a_run(3, None), a_run(4, 0.2, stop_error_m=0.4)]
    told = summary(runs)
    assert (told["runs"], told["formed"], told["outcomes"]) == (4, 3, {"formed": 3, "held": 1})
    assert told["placement_error_m"] == pytest.approx({"p50": 0.2, "p95": 0.29, "max": 0.3})
    assert told["stop_error_m"] == pytest.approx({"p50": 0.2, "p95": 0.38, "max": 0.4})
    assert told["duration_s"] == pytest.approx({"p50": 32.5, "p95": 33.85, "max": 34.0})
    assert told["emission_transmitter_s"] == {"p50": 60.0, "p95": 60.0, "max": 60.0}
    assert told["min_separation_m"] == 11.0
    assert told["reasons"] == {"silent": 1}
    assert told["by_receiver"]["U1"]["placed"] == 3
    assert placement_errors_m(runs) == {"U1": [0.1, 0.3, 0.2]}


def test_nothing_flown_is_null_and_draws_nothing(tmp_path: Path) -> None:
    assert distribution([None]) == {"p50": None, "p95": None, "max": None}
    told = summary([])
    assert (told["runs"], told["min_separation_m"], told["placement_error_m"]["max"]) == (0, None, None)
    assert draw_placement_errors({"U1": []}, tmp_path, "nothing") == []


def test_a_row_for_each_receiver_and_run(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    write_rows([a_run(1), a_run(2, None)], path)
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    assert tuple(rows[0]) == COLUMNS
    assert [(row["seed"], row["state"], row["placement_error_m"]) for row in rows] == [
        ("1", "PLACED", "0.1"),
        ("2", "HELD", ""),
    ]


def test_parquet_takes_pyarrow_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "rows.parquet"
    if importlib.util.find_spec("pyarrow") is None:
        with pytest.raises(ServiceError, match=r"bearing-relay\[study\]"):
            write_rows([a_run(1)], path)
        return
    write_rows([a_run(1), a_run(2, None)], path)
    table = importlib.import_module("pyarrow.parquet").read_table(path)
    assert table.column_names == list(COLUMNS)
    assert table["placement_error_m"].to_pylist() == [0.1, None]
    assert table["seed"].to_pylist() == [1, 2]


def test_dask_takes_dask_and_says_so() -> None:
    if importlib.util.find_spec("distributed") is not None:
        pytest.skip("dask is there")
    with pytest.raises(ServiceError, match=r"bearing-relay\[study\]"), dask_pool("tcp://127.0.0.1:1"):
        pass


def test_pictures_show_every_receiver(tmp_path: Path) -> None:
    drawn = draw_placement_errors({"U1": [0.1, 0.2, 0.4], "U2": [0.3]}, tmp_path / "new" / "folder", "a study")
    histogram, distributions = (path.read_text(encoding="utf-8") for path in drawn)
    assert 'id="p95"' in histogram
    for name in ("U1", "U2", "all"):
        assert f'id="ecdf-{name}"' in distributions
