"""Which run the dashboard shows."""

import json
import os

import pytest

from gcs.errors import ServiceError
from gcs.monitor.web.finding import RunFinder
from gcs.recording.bus_address import BusAddress


def run_in(runs_dir, name, age_s=0.0):
    folder = runs_dir / name
    folder.mkdir(parents=True)
    path = folder / "bus.json"
    path.write_text(json.dumps({"endpoint": f"tcp/127.0.0.1:7{len(name)}", "swarm": name}))
    at_s = path.stat().st_mtime - age_s
    os.utime(path, (at_s, at_s))
    return folder


def test_without_a_name_it_is_the_newest_run_and_the_next_when_one_begins(tmp_path):
    finder = RunFinder(tmp_path)
    with pytest.raises(ServiceError, match="no run in"):
        finder.find()
    run_in(tmp_path, "first", age_s=10.0)
    assert finder.find().swarm == "first"
    newest = run_in(tmp_path, "second")
    assert finder.find().swarm == "second"
    assert finder.report() is None
    (newest / "report.html").write_text("formed")
    assert finder.report() == newest / "report.html"


def test_a_run_that_is_named_stays_the_one(tmp_path):
    old = run_in(tmp_path, "first", age_s=10.0)
    run_in(tmp_path, "second")
    assert RunFinder(tmp_path, run=old).find().swarm == "first"


def test_a_run_elsewhere_is_found_by_its_bus_and_has_no_report_here(tmp_path):
    finder = RunFinder(tmp_path, connect="tcp/10.0.0.1:7447", swarm="three")
    assert finder.find() == BusAddress("tcp/10.0.0.1:7447", "three")
    assert finder.report() is None


def test_a_run_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ServiceError, match="no run folder"):
        RunFinder(tmp_path, run=tmp_path / "none")


def test_a_swarm_that_is_no_name_is_refused(tmp_path):
    with pytest.raises(ServiceError, match="no name of a swarm"):
        RunFinder(tmp_path, connect="tcp/10.0.0.1:7447", swarm="*")
