"""Whether a locked package has a known hole, as pip-audit says; what could not be looked at is said loudly.

Where pip-audit's services cannot be reached, PyPI's project pages are asked, which know the newest version of each
package only. Exit status 1 when there is a hole; and when a package was not looked at, where AUDIT_REQUIRED is set.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

LOCK = Path(__file__).parents[1] / "requirements.lock"
PINNED = re.compile(r"(?m)^([\w.-]+)==([^\s;\\]+)")
CONTROL = "jinja2==2.4.1 --hash=sha256:" + "0" * 64
CONTROL_PAGE = ("pycrypto", "2.6.1")
"""These have holes: who does not know them knows nothing."""


@dataclass
class Told:
    """What somebody knows of locked packages."""

    holes: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)


def by_service(service: str) -> Told | None:
    """Return what pip-audit hears from a service of the lock; None when it hears nothing of use."""
    with tempfile.TemporaryDirectory() as folder:
        control = Path(folder) / "control.txt"
        control.write_text(CONTROL)
        if not any(package.get("vulns") for package in _pip_audit(control, service)):
            return None
    if not (packages := _pip_audit(LOCK, service)):
        return None
    found = [
        (f"{package['name']} {package['version']}", package) for package in packages if "skip_reason" not in package
    ]
    holes = [f"{name}: {hole['id']}" for name, package in found for hole in package["vulns"]]
    return Told(holes, [package["name"] for package in packages if "skip_reason" in package])


def by_project_pages() -> Told | None:
    """Return what PyPI's pages say of the newest versions; None when they cannot be read or know of no holes."""
    with ThreadPoolExecutor(8) as pool:
        control, *told = pool.map(_page_says, [CONTROL_PAGE, *PINNED.findall(LOCK.read_text())])
    if not control.holes:
        return None
    return Told([hole for each in told for hole in each.holes], [name for each in told for name in each.unknown])


def _pip_audit(requirements: Path, service: str) -> list[dict[str, Any]]:
    command = [sys.executable, "-m", "pip_audit", "-r", str(requirements), "--disable-pip", "--require-hashes"]
    options = ["--vulnerability-service", service, "--format", "json", "--progress-spinner", "off", "--timeout", "10"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=600, check=False)
    try:
        packages: list[dict[str, Any]] = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return []
    return packages


def _page_says(pin: tuple[str, str]) -> Told:
    name, version = pin
    for _ in range(3):
        try:
            with urllib.request.urlopen(f"https://pypi.org/pypi/{name}/json", timeout=20) as page:
                told = json.load(page)
            break
        except (OSError, ValueError):
            continue
    else:
        return Told(unknown=[f"{name} {version}"])
    newest, holes = told["info"]["version"], [f"{name} {version}: {hole['id']}" for hole in told["vulnerabilities"]]
    return Told(holes) if newest == version else Told(unknown=[f"{name} {version} (not the newest)"])


def main() -> int:
    """Ask whoever knows the most and can be reached."""
    told = by_service("pypi") or by_service("osv") or by_project_pages()
    if told is None:
        print("!!! NOT AUDITED: no advisory service (PyPI, OSV) can be reached from here !!!")
        return int("AUDIT_REQUIRED" in os.environ)
    for hole in told.holes:
        print(f"HOLE: {hole}")
    if told.unknown:
        print(f"!!! NOT AUDITED: {', '.join(told.unknown)} !!!")
    count = len(PINNED.findall(LOCK.read_text()))
    print(f"{count} locked packages, {len(told.holes)} known holes, {len(told.unknown)} not looked at")
    return int(bool(told.holes) or (bool(told.unknown) and "AUDIT_REQUIRED" in os.environ))


if __name__ == "__main__":
    sys.exit(main())
