"""The command line: what a user types, what comes back, and that no traceback ever does."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.cli import main

ROOT = Path(__file__).parents[2]
PAPER_8 = "sitl_configs/paper_8.yaml"


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Run the command line; return exit status, standard output and standard error."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    output = capsys.readouterr()
    return int(ended.value.code or 0), output.out, output.err


def test_plan_prints_writes_and_draws(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    made, drawn = tmp_path / "plan.json", tmp_path / "plan.svg"
    status, out, _ = run(capsys, "plan", PAPER_8, "--json", str(made), "--plot", str(drawn))
    assert status == 0
    assert "total 491.59 m" in out
    data = json.loads(made.read_text())
    assert data["total_length_m"] == pytest.approx(491.59, abs=0.01)
    assert [receiver["slot"] for receiver in data["receivers"]] == [f"O{k}" for k in range(1, 9)]
    assert drawn.read_text().startswith("<?xml")


@pytest.mark.parametrize(("separation", "total"), [("0", 830.42), ("5", 951.32)])
def test_the_separation_decides_the_twenty(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, separation: str, total: float
) -> None:
    made = tmp_path / "plan.json"
    status, _, _ = run(
        capsys,
        "plan",
        "sitl_configs/paper_20.yaml",
        "--method",
        "paper",
        "--min-separation",
        separation,
        "--json",
        str(made),
    )
    assert status == 0
    assert json.loads(made.read_text())["total_length_m"] == pytest.approx(total, abs=0.01)


def test_paper_agrees_with_print(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "paper")
    assert status == 0
    for total in ("491.59", "830.42", "951.32"):
        assert total in out


def test_paper_redraws_its_figures(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, _, _ = run(capsys, "paper", "--plots", str(tmp_path / "figures"))
    assert status == 0
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        "figure_9.svg", "figure_10a.svg", "figure_10b.svg", "figure_10c.svg", "figure_10d.svg",
    }  # fmt: skip


def test_the_default_method_is_near_straight_and_predicts_its_errors(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = Path(PAPER_8).read_text().replace("  method: paper", "  # method: paper")
    playbook, made, gdop = tmp_path / "eight.yaml", tmp_path / "plan.json", tmp_path / "gdop.svg"
    playbook.write_text(text)
    options = ["--sigma-deg", "0.5", "--reference", "body", "--tolerance-3sigma", "5"]
    status, _, _ = run(capsys, "plan", str(playbook), *options, "--json", str(made), "--dilution", str(gdop))
    assert status == 0
    data = json.loads(made.read_text())
    assert data["method"] == "joint"
    assert data["total_length_m"] <= 379.0
    assert max(receiver["predicted_3sigma_m"] for receiver in data["receivers"]) <= 5.0
    assert gdop.read_text().startswith("<?xml")


def test_the_objective_can_be_chosen(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    made = tmp_path / "plan.json"
    options = ["--method", "joint", "--objective", "balanced", "--sigma-deg", "0.5", "--json", str(made)]
    status, _, _ = run(capsys, "plan", PAPER_8, *options)
    data = json.loads(made.read_text())
    assert status == 0
    assert data["makespan_s"] <= 42.0
    assert data["total_length_m"] <= 1.09 * data["straight_line_bound_m"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "nowhere.yaml"], "nowhere.yaml:1:1: cannot be read"),
        (["fly", "README.md"], "README.md:"),
        (["demo", "--uavs", "7"], "--uavs 8 and --uavs 20"),
        (["plan", PAPER_8, "--method", "magic"], "magic"),
        (["plan", PAPER_8, "--min-separation", "-1"], "min-separation"),
        (["plan", PAPER_8, "--min-separation", "200"], "no feasible relay plan"),
        (["plan", PAPER_8, "--json", "/nowhere/plan.json"], "/nowhere/plan.json cannot be written"),
        (["plan", PAPER_8, "--plot", "plan.bmp"], "bmp"),
        (["demo", "--speedup", "0"], "speedup"),
        (["nonsense"], "nonsense"),
    ],
)
def test_what_is_wrong_is_one_clear_message(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    status, _, err = run(capsys, *arguments)
    assert status == 2
    assert words in re.sub(r"\s+", " ", err)
    assert "Traceback" not in err


def test_speedup_is_for_embedded_copters_only(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    names = ["L0", "L1", *(f"U{k}" for k in range(1, 9))]
    links = "".join(
        f"  {name}: {{link: 'udpin:127.0.0.1:0', system_id: {k}}}\n" for k, name in enumerate(names, start=1)
    )
    playbook = tmp_path / "real.yaml"
    playbook.write_text(Path(PAPER_8).read_text() + "\nvehicles:\n" + links)
    status, _, err = run(capsys, "fly", str(playbook), "--speedup", "2", "--runs-dir", str(tmp_path))
    assert status == 2
    assert "embedded copters only" in err


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "--help")
    assert status == 0
    for command in ("demo", "plan", "fly", "paper", "copter"):
        assert command in out


def test_an_internal_error_is_kept_in_a_file_not_shown(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("gcs.commands.plan.load_playbook", lambda _: 1 / 0)
    status, _, err = run(capsys, "plan", PAPER_8)
    assert status == 2
    assert "internal error: ZeroDivisionError" in err
    assert "Traceback" not in err
    kept = list(tmp_path.glob("bearing-relay-*.txt"))
    assert len(kept) == 1
    assert "Traceback" in kept[0].read_text()


def test_the_installed_command_starts() -> None:
    shown = subprocess.run(
        [sys.executable, "-m", "gcs.cli", "--help"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert "bearing-relay" in shown.stdout


def test_the_readme_s_playbook_loads_and_plans(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = re.search(r"```yaml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert text is not None
    playbook = tmp_path / "readme.yaml"
    playbook.write_text(text[1])
    status, out, _ = run(capsys, "plan", str(playbook))
    assert status == 0
    assert "U3" in out


def test_every_command_line_of_the_readme_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    commands = set(re.findall(r"bearing-relay ([a-z]+)\b", (ROOT / "README.md").read_text()))
    _, out, _ = run(capsys, "--help")
    assert commands
    assert all(command in out for command in commands)
