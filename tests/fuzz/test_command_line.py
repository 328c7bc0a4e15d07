"""The command line, whatever it is given: one message that says what is wrong, exit status 2, never a traceback."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.cli import main

FOUR = Path("sitl_configs/four.yaml").read_text(encoding="utf-8")
LONGEST_S = 20.0


def folder(path: Path) -> None:
    path.mkdir()


def closed(path: Path) -> None:
    path.write_text(FOUR)
    path.chmod(0)


def circle(path: Path) -> None:
    path.symlink_to(path)


def holding(content: str | bytes) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    return make


BOMB = FOUR + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" if n else "a0: &a0 [1]\n" for n in range(20))
FILES: dict[str, Callable[[Path], None]] = {
    "missing": lambda path: None,
    "folder": folder,
    "circle": circle,
    "empty": holding(""),
    "binary": holding(bytes(range(256)) * 64),
    "ten_mb": holding(b"a: 1\n" * 2_000_000),
    "twice": holding(FOUR + "name: again\n"),
    "bomb": holding(BOMB),
    "itself": holding("a: &a [*a]\n" + FOUR),
    "deep": holding("[" * 400),
    "deep_json": holding('{"a":' * 3000),
    "huge": holding(FOUR + "seed: " + "9" * 6000 + "\n"),
    "surrogate": holding('name: "\\ud800"\nplaybook: "\\ud800"\n'),
    "list": holding("[1, 2, 3]"),
}
if os.geteuid() != 0:
    FILES["closed"] = closed

TAKES_A_FILE = (
    ("plan", "FILE"),
    ("check", "FILE"),
    ("check", "FILE", "--json"),
    ("fly", "FILE", "--dry-run"),
    ("fly", "FILE"),
    ("simulate", "FILE", "--runs", "1"),
    ("simulate", "FILE", "--resume", "FILE"),
    ("faults", "FILE", "--runs", "1"),
    ("test", "FILE"),
    ("keys", "init", "FILE", "--out", "OUT", "--router", "tls/127.0.0.1:1"),
    ("sitl", "up", "FILE", "--autopilot", "ardupilot"),
    ("report", "FILE"),
    ("report", "FILE", "FILE", "--out", "OUT"),
    ("replay", "FILE"),
    ("replay", "FILE", "--speed", "1000"),
    ("resume", "FILE"),
    ("control", "hold", "--run", "FILE"),
    ("control", "hold", "--connect", "tls/127.0.0.1:1", "--swarm", "x", "--keys", "FILE"),
    ("control", "hold", "--connect", "tcp/127.0.0.1:1", "--swarm", "x", "--command-token-file", "FILE"),
    ("sensor", "krakensdr", "--swarm", "x", "--uav", "U1", "--connect", "tcp/127.0.0.1:1", "--settings", "FILE"),
    ("sensor", "replay", "--swarm", "x", "--uav", "U1", "--connect", "tcp/127.0.0.1:1", "--settings", "FILE"),
    ("sensor", "replay", "--swarm", "x", "--uav", "U1", "--connect", "tls/127.0.0.1:1", "--keys", "FILE"),
    ("dashboard", "--run", "FILE", "--command-token-file", "FILE"),
    ("dashboard", "--certificate", "FILE", "--key", "FILE"),
)
ALIKE = ("check", "fly", "simulate", "faults", "test", "keys", "sitl")
"""They read a playbook as `plan` does."""
FEW = ("missing", "surrogate")
NUMBERS = ("nan", "-inf", "-1", "1e308", "9" * 400, "ten", "")
TAKES_A_NUMBER = (
    ("plan", "PLAYBOOK", "--min-separation"),
    ("plan", "PLAYBOOK", "--sigma-deg"),
    ("plan", "PLAYBOOK", "--tolerance-3sigma"),
    ("fly", "nowhere.yaml", "--speedup"),
    ("demo", "--uavs", "7", "--seed"),
    ("demo", "--uavs", "7", "--sigma-deg"),
    ("simulate", "nowhere.yaml", "--runs"),
    ("simulate", "nowhere.yaml", "--speed"),
    ("simulate", "nowhere.yaml", "--jobs"),
    ("faults", "nowhere.yaml", "--seed"),
    ("keys", "init", "PLAYBOOK", "--router", "tls/nowhere:1", "--out", "README.md", "--days"),
    ("replay", "nowhere", "--speed"),
    ("replay", "nowhere", "--set"),
    ("copter", "--name", "U1", "--link", "nowhere", "--home", "0,0,0,0", "--system-id", "1", "--speedup"),
    ("copter", "--name", "U1", "--link", "udpout:127.0.0.1:1", "--system-id", "1", "--home"),
)
ACCEPTED = {("--tolerance-3sigma", "1e308")}
"""What is a number there after all."""
WRONG = (
    ("plan",),
    ("plan", "PLAYBOOK", "--json", "README.md/x"),
    ("plan", "PLAYBOOK", "--json", "/"),
    ("plan", "PLAYBOOK", "--plot", "README.md/x.svg"),
    ("plan", "PLAYBOOK", "--plot", "OUT.doc"),
    ("plan", "PLAYBOOK", "--dilution", "/"),
    ("plan", "\0"),
    ("plan", "x" * 5000),
    ("plan", "\udcff\udcfe"),
    ("fly", "nowhere.yaml", "--dashboard", "0.0.0.0:0"),
    ("fly", "PLAYBOOK", "--target", "vehicles"),
    ("test", "nowhere", "-k", "["),
    ("test", "OUT", "--junit", "/"),
    ("simulate", "PLAYBOOK", "--runs", "1", "--studies-dir", "README.md"),
    ("simulate", "PLAYBOOK", "--runs", "1", "--studies-dir", "OUT", "--dask", "nowhere"),
    ("faults", "PLAYBOOK", "--runs", "1", "--json", "/"),
    ("keys", "init", "PLAYBOOK", "--router", "tcp/1.2.3.4:5", "--out", "OUT"),
    ("keys", "init", "PLAYBOOK", "--router", "tls/a b:1", "--out", "OUT"),
    ("keys", "init", "PLAYBOOK", "--router", "tls/1.2.3.4:5", "--out", "OUT", "--swarm", "**"),
    ("sensor",),
    ("sensor", "nonsense"),
    ("sensor", "replay", "--swarm", "**", "--uav", "U1", "--connect", "tcp/127.0.0.1:1"),
    ("sensor", "replay", "--swarm", "x", "--uav", "U1", "--connect", "nowhere"),
    ("sensor", "replay", "--swarm", "x", "--uav", "U1", "--connect", "tcp/10.0.0.1:1"),
    ("control", "hold", "--connect", "nonsense", "--swarm", "x"),
    ("control", "hold", "--connect", "tcp/127.0.0.1:99999", "--swarm", "x"),
    ("control", "hold", "--connect", "tcp/127.0.0.1:1", "--swarm", "a/**"),
    ("control", "skip", "x" * 1000, "--connect", "tcp/127.0.0.1:1", "--swarm", "x"),
    ("control", "nonsense"),
    ("monitor", "--swarm", "**"),
    ("dashboard", "--listen", "nowhere"),
    ("dashboard", "--listen", "127.0.0.1:99999"),
    ("dashboard", "--listen", "999.999.999.999:80"),
    ("dashboard", "--swarm", "**"),
    ("report", "PLAYBOOK", "--out", "/"),
    ("schema", "--out", "/"),
    ("paper", "--plots", "README.md"),
    ("sitl", "status", "--folder", "README.md"),
    ("copter",),
    ("copter", "--link", "nowhere"),
    ("\0",),
    ("--\udcff",),
    ("",),
)


@pytest.fixture
def clean(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run a command that cannot succeed, and check that it says so as it should."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("ARDUCOPTER", "PX4", "BEARING_RELAY_COMMAND_TOKEN", "BEARING_RELAY_VIEW_TOKEN"):
        monkeypatch.delenv(name, raising=False)

    def run(arguments: tuple[str, ...], **places: str) -> None:
        known = {"PLAYBOOK": "sitl_configs/four.yaml", "OUT": str(tmp_path / "out")} | places
        given = [known.get(argument, argument) for argument in arguments]
        began_s = time.process_time()
        with pytest.raises(SystemExit) as ended:
            main(given)
        output = capsys.readouterr()
        said = output.out + output.err
        assert "internal error" not in said, given
        assert "Traceback" not in said, given
        assert ended.value.code not in (0, None), given
        assert said.strip(), given
        assert time.process_time() - began_s < LONGEST_S, given
        said.encode()

    return run


@pytest.mark.parametrize("arguments", TAKES_A_FILE, ids=" ".join)
def test_a_file_that_is_none_of_ours(clean: Callable[..., None], tmp_path: Path, arguments: tuple[str, ...]) -> None:
    for name in FEW if arguments[0] in ALIKE else FILES:
        path = tmp_path / f"{name}.yaml"
        FILES[name](path)
        if path.is_file() and path.stat().st_mode:
            path.chmod(0o600)
        clean(arguments, FILE=str(path))


@pytest.mark.parametrize("arguments", TAKES_A_NUMBER, ids=" ".join)
def test_a_number_that_is_none(clean: Callable[..., None], arguments: tuple[str, ...]) -> None:
    for number in NUMBERS:
        if (arguments[-1], number) not in ACCEPTED:
            clean((*arguments, number))


@pytest.mark.parametrize("arguments", WRONG, ids=map(ascii, range(len(WRONG))))
def test_what_cannot_be_meant(clean: Callable[..., None], arguments: tuple[str, ...]) -> None:
    clean(arguments)


def test_an_internal_error_is_no_clean_end(clean: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> None:
    """The check itself can fail."""
    monkeypatch.setattr("gcs.commands.plan.load_playbook", lambda _: 1 / 0)
    with pytest.raises(AssertionError, match="internal error"):
        clean(("plan", "PLAYBOOK"))
