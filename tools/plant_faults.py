"""Plants faults in a copy of the source, one at a time, and reports which ones the tests detect.

    python tools/plant_faults.py                      # every fault of tools/faults.py
    python tools/plant_faults.py rl/batch gym         # faults of files whose paths contain a word
    python tools/plant_faults.py --list

A fault is a file of the package, a text in it and a wrong text. The tests of the file's own part
must detect it: for rl/batch.py, tests/rl/test_batch.py and then the rest of tests/rl. Everything
runs in a temporary copy of the repository; the working tree is never changed.

The exit status is 0 if every fault was caught. A fault whose text does not occur exactly once in
the file is reported as stale, and should be corrected or removed. If the test also fails without
the fault, or the tests cannot be collected with it, it is reported as broken. Run this by hand: it
takes about ten seconds for each fault that is caught, and the time of all tests of the part for
each one that is not.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from faults import FAULTS, TESTS

REPOSITORY = Path(__file__).parents[1]
PACKAGE = Path("src", "limberjack")

CAUGHT, MISSED, STALE, BROKEN = "caught", "MISSED", "STALE", "BROKEN"
_LIMIT = 1200  # seconds for the tests of one fault; a fault that hangs them counts as caught
_FAILED, _PASSED = 1, 0  # pytest's exit statuses; every other one is an error of its own


class Fault(NamedTuple):
    """A plausible mistake: in `file`, below the package, `new` replaces `old`."""

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


def part_of(file: str, repository: Path) -> list[str]:
    """The tests of a file's part: its own modules first, since they are likely to fail first."""
    path = Path(file)
    folder = Path("tests", *(part.lstrip("_") for part in path.parts[:-1]))
    own = sorted((repository / folder).glob(f"test_{path.stem.lstrip('_')}*.py"))
    part = TESTS.get(path.parts[0], [f"tests/{path.parts[0]}"])
    return [*(str(module.relative_to(repository)) for module in own), *part]


class Copy:
    """A copy of the repository in which faults are planted and tests run."""

    def __init__(self, folder: Path, repository: Path = REPOSITORY) -> None:
        """Copies the repository, except for caches and git's data, into an empty folder."""
        ignored = shutil.ignore_patterns(".*", "__pycache__", "demo", "shared")
        shutil.copytree(repository, folder, ignore=ignored, dirs_exist_ok=True)
        self.folder = folder
        self._passing: dict[str, bool] = {}  # by test: whether it passes without a fault

    def verdict(self, fault: Fault) -> tuple[str, str]:
        """The verdict on a fault, and the test that detected it or the reason."""
        path = self.folder / PACKAGE / fault.file
        source = path.read_text(encoding="utf-8") if path.exists() else ""
        wrong = planted(source, fault)
        if wrong is None:
            return STALE, f"the text is there {source.count(fault.old)} times; expected once"
        path.write_text(wrong, encoding="utf-8")
        try:
            kind, why = self._tested_in_turn(part_of(fault.file, self.folder))
        finally:
            path.write_text(source, encoding="utf-8")
        if kind == CAUGHT and not self._passes_without_fault(why):
            return BROKEN, f"fails without the fault too: {why}"
        return kind, why

    def _tested_in_turn(self, tests: list[str]) -> tuple[str, str]:
        """The result of the first of the tests that does not pass."""
        for one in tests:
            kind, why = self._tested([one])
            if kind != MISSED:
                return kind, why
        return MISSED, f"{' '.join(tests)} pass"

    def _tested(self, tests: list[str]) -> tuple[str, str]:
        """The result of the tests in the copy, and the test that failed, if one did."""
        options = ["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "-rfE"]
        unwritten = {"PYTHONDONTWRITEBYTECODE": "1"}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", *options, *tests],
                cwd=self.folder,
                env={**os.environ, **unwritten, "PYTHONPATH": str(self.folder / "src")},
                capture_output=True,
                text=True,
                timeout=_LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return CAUGHT, ""
        if done.returncode == _PASSED:
            return MISSED, ""
        failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
        if done.returncode == _FAILED and failed:
            return CAUGHT, failed[0]
        return BROKEN, (done.stdout + done.stderr)[-200:]

    def _passes_without_fault(self, test: str) -> bool:
        if test not in self._passing:
            self._passing[test] = not test or self._tested([test])[0] == MISSED
        return self._passing[test]


def main(arguments: list[str] | None = None) -> int:
    """Plants the faults named on the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("words", nargs="*", help="parts of paths; all faults if there are none")
    parser.add_argument("--list", action="store_true", help="print the faults and plant none")
    options = parser.parse_args(arguments)
    faults = listed(options.words)
    if options.list:
        print(*faults, sep="\n")
        return 0
    counts: dict[str, int] = dict.fromkeys((CAUGHT, MISSED, STALE, BROKEN), 0)
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        copy = Copy(Path(folder))
        for fault in faults:
            began = time.monotonic()
            kind, why = copy.verdict(fault)
            counts[kind] += 1
            print(f"{kind:7}{time.monotonic() - began:5.0f} s  {fault}\n{'':16}{why}", flush=True)
    print(", ".join(f"{count} {kind.lower()}" for kind, count in counts.items()))
    return 0 if counts[CAUGHT] == len(faults) else 1


if __name__ == "__main__":
    sys.exit(main())
