"""What nobody thought of: a reader searched by coverage, for as long as one likes.

    pip install atheris
    python -m tests.fuzz.guided READER [-max_total_time=SECONDS] [FOLDER]

It changes an honest example by what that makes the reader do, until something comes out that must not. FOLDER keeps
what it has found to be of interest; further arguments are those of libFuzzer. The readers are in `tests.fuzz.readers`.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
from pathlib import Path


def main() -> None:
    """Search one reader; the process ends with a status other than 0, and the bytes in a file, when it finds any."""
    try:
        atheris = importlib.import_module("atheris")
    except ImportError:
        sys.exit("this takes atheris: pip install atheris")
    with atheris.instrument_imports(include=["drivers", "gcs", "planner", "ruamel.yaml"]):
        readers = importlib.import_module("tests.fuzz.readers").READERS
    name, *options = sys.argv[1:] or [""]
    if name not in readers:
        sys.exit(f"one of {', '.join(readers)} is searched, not {name!r}")
    example, read = readers[name]
    folders = [option for option in options if not option.startswith("-")]
    begin = Path(folders[0] if folders else tempfile.mkdtemp(prefix=f"guided-{name}-"))
    begin.mkdir(parents=True, exist_ok=True)
    (begin / "example").write_bytes(example())
    arguments = [option for option in options if option.startswith("-")]
    atheris.Setup([sys.argv[0], "-len_control=0", "-max_len=20000", *arguments, str(begin)], read)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
