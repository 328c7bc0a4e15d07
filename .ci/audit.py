"""Whether a locked package has a known hole: pip-audit of requirements.lock, which says so when nobody could be asked.

Exit status 1 when there is a hole; and when a package was not looked at, where AUDIT_REQUIRED is set.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

LOCK = Path(__file__).parents[1] / "requirements.lock"
CONTROL = "jinja2==2.4.1 --hash=sha256:" + "0" * 64
"""It has holes: a service that does not know them knows nothing."""


def audited(requirements: Path, service: str) -> list[dict[str, Any]]:
    """Return what a service knows of each requirement; nothing when it does not answer."""
    command = [sys.executable, "-m", "pip_audit", "-r", str(requirements), "--disable-pip", "--require-hashes"]
    options = ["--vulnerability-service", service, "--format", "json", "--progress-spinner", "off", "--timeout", "10"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=600, check=False)
    try:
        dependencies: list[dict[str, Any]] = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return []
    return dependencies


def main() -> int:
    """Ask the first service that knows of the control's holes."""
    with tempfile.TemporaryDirectory() as folder:
        control = Path(folder) / "control.txt"
        control.write_text(CONTROL)
        service = next((name for name in ("pypi", "osv") if any(d.get("vulns") for d in audited(control, name))), None)
    told = audited(LOCK, service) if service else []
    holes = [f"{d['name']} {d['version']}: {hole['id']}" for d in told for hole in d.get("vulns", ())]
    unknown = [d["name"] for d in told if "skip_reason" in d]
    for hole in holes:
        print(f"HOLE: {hole}")
    if service is None or not told or unknown:
        print(
            f"!!! NOT AUDITED: {', '.join(unknown) or 'no advisory service (PyPI, OSV) can be reached from here'} !!!"
        )
        return int(bool(holes) or "AUDIT_REQUIRED" in os.environ)
    print(f"{len(told)} locked packages, {len(holes)} known holes")
    return int(bool(holes))


if __name__ == "__main__":
    sys.exit(main())
