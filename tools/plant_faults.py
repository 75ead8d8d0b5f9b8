"""Plant faults into a copy of the source, one at a time, and report which the tests notice.

    python tools/plant_faults.py                      # every fault of tools/faults.py
    python tools/plant_faults.py rl/batch gym         # those of files whose paths contain a word
    python tools/plant_faults.py --list

A fault is a file of the package, a text in it and a wrong text. The tests that must notice it are
those of the file's own part: for rl/batch.py, tests/rl/test_batch.py and then the rest of tests/rl.
The working tree is never changed: tests import the package from a temporary copy.

The exit status is 0 if every fault was caught. A fault whose text is not in the file exactly once
is reported as stale, and is to be corrected or removed. Run it by hand: it takes about ten seconds
for each fault that is caught, and as long as a part's tests for each that is not.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from faults import FAULTS, TESTS

REPOSITORY = Path(__file__).parents[1]
PACKAGE = Path("src", "limberjack")

CAUGHT, MISSED, STALE, BROKEN = "caught", "MISSED", "STALE", "BROKEN"
_LIMIT = 1200  # seconds for the tests of one fault; a fault that hangs them counts as caught
_FAILED, _PASSED = 1, 0  # pytest's exit statuses; every other one is an error of its own


class Fault(NamedTuple):
    """A plausible mistake: in `file`, below the package, `new` stands where `old` should."""

    file: str
    old: str
    new: str

    def __str__(self) -> str:
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.file}: {old!r} -> {new!r}"


def listed(words: list[str]) -> list[Fault]:
    """The faults of files whose paths contain any of the words; all if there are none."""
    return [
        Fault(file, old, new)
        for file, changes in FAULTS.items()
        if not words or any(word in file for word in words)
        for old, new in changes
    ]


def planted(source: str, fault: Fault) -> str | None:
    """The source with the fault; None unless it has the fault's text exactly once."""
    return source.replace(fault.old, fault.new) if source.count(fault.old) == 1 else None


def part_of(file: str, repository: Path = REPOSITORY) -> list[str]:
    """The tests of a file's part: its own module first, since that is likely to fail first."""
    path = Path(file)
    folder = Path("tests", *(part.lstrip("_") for part in path.parts[:-1]))
    own = folder / f"test_{path.name.lstrip('_')}"
    part = TESTS.get(path.parts[0], [f"tests/{path.parts[0]}"])
    return [str(own)] * (repository / own).exists() + part


def verdict(fault: Fault, repository: Path, copy: Path) -> tuple[str, str]:
    """What became of a fault, and the test that noticed it or what went wrong."""
    path = copy / PACKAGE / fault.file
    source = path.read_text(encoding="utf-8") if path.exists() else ""
    wrong = planted(source, fault)
    if wrong is None:
        return STALE, f"the text is there {source.count(fault.old)} times; expected once"
    path.write_text(wrong, encoding="utf-8")
    try:
        return _tested(part_of(fault.file, repository), repository, copy)
    finally:
        path.write_text(source, encoding="utf-8")


def _tested(tests: list[str], repository: Path, copy: Path) -> tuple[str, str]:
    """What a run of the tests says of the copy."""
    environment = {**os.environ, "PYTHONPATH": str(copy / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "-rfE"]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *tests],
            cwd=repository,
            env=environment,
            capture_output=True,
            text=True,
            timeout=_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return CAUGHT, f"the tests ran for more than {_LIMIT} s"
    if done.returncode == _PASSED:
        return MISSED, f"{' '.join(tests)} pass"
    lines = done.stdout.splitlines()
    first = next((line for line in lines if line.startswith(("FAILED ", "ERROR "))), lines[-1:])
    return (CAUGHT if done.returncode == _FAILED else BROKEN), str(first)[:150]


def _copied(repository: Path) -> Iterator[Path]:
    """A temporary folder with a copy of the source, removed afterwards."""
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(repository / "src", Path(folder, "src"), ignore=ignored)
        yield Path(folder)


def main(arguments: list[str] | None = None) -> int:
    """Plants the faults that the command line names; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("words", nargs="*", help="parts of paths; all faults if there are none")
    parser.add_argument("--list", action="store_true", help="print the faults and plant none")
    options = parser.parse_args(arguments)
    faults = listed(options.words)
    if options.list:
        print(*faults, sep="\n")
        return 0
    counts = dict.fromkeys((CAUGHT, MISSED, STALE, BROKEN), 0)
    for copy in _copied(REPOSITORY):
        for fault in faults:
            began = time.monotonic()
            kind, why = verdict(fault, REPOSITORY, copy)
            counts[kind] += 1
            print(f"{kind:7}{time.monotonic() - began:5.0f} s  {fault}\n{'':16}{why}", flush=True)
    print(", ".join(f"{count} {kind.lower()}" for kind, count in counts.items()))
    return 0 if counts[CAUGHT] == len(faults) else 1


if __name__ == "__main__":
    sys.exit(main())
