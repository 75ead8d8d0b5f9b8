"""Which results are older than the source that they were measured with.

    python benchmarks/sources.py                    # prints them
    python benchmarks/sources.py rows.json          # records that a file has just been measured

`results/sources.json` has, for each file in `results`, the parts of the package that its figures
depend on, and their fingerprint at the time. `make test` prints what is older, without failing: a
figure is measured again when somebody has reason to believe that it has changed.
"""

import fnmatch
import hashlib
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from limberjack.utils.files import write_whole

__all__ = ["RESULTS", "fingerprint", "names", "outdated", "parts_of", "record", "write"]

RESULTS = Path(__file__).parent / "results"

_LEDGER = "sources.json"
_PACKAGE = Path(__file__).parents[1] / "src" / "limberjack"
_SIMULATED = ("suite", "mujoco", "rl")  # folders that the numbers of any task depend on
# Folders and files of the package, by pattern of the results' names. A score depends on its domain,
# on its policy, and on what simulates.
_PARTS = {
    "scores/*-planner.json": ("suite/{domain}.*", "planner", "mujoco", "rl"),
    "scores/*-zero.json": ("suite/{domain}.*", "policies", "mujoco", "rl"),
    "arm_datasets/*": ("suite/manipulator.*", "suite/stacker.*", "planner", "mujoco", "rl"),
    "baselines.json": ("policies", *_SIMULATED),
    "bridge.json": ("policies/mlp.py", "policies/pretrained/*", *_SIMULATED),
    "classes.json": ("planner", *_SIMULATED),
    "collecting.json": ("episodes", "policies", "workers", *_SIMULATED),
    "drq/*.csv": ("gym", *_SIMULATED),
    "exactness.json": _SIMULATED,
    "from_datasets.json": ("episodes", "policies", *_SIMULATED),
    "installing.json": ("policies/pretrained/*",),
    "learned/*.json": ("suite/{domain}.*", "policies/mlp.py", "training", "mujoco", "rl"),
    "many.json": ("gym", *_SIMULATED),
    "optimisers.json": ("planner", *_SIMULATED),
    "overhead.json": ("gym", *_SIMULATED),
    "path_searches.json": ("planner", *_SIMULATED),
    "planner.json": ("planner", *_SIMULATED),
    "played_again.json": ("planner", *_SIMULATED),
    "reach.json": ("suite/manipulator.*", "suite/stacker.*"),
    "reading.json": ("episodes",),
    "rendering.json": ("mujoco", "suite"),
    "rows.json": ("gym", *_SIMULATED),
    "scaling.json": ("episodes", "evaluation", "policies", "workers", *_SIMULATED),
    "steps_per_second.json": ("gym", *_SIMULATED),
    "suite_speed.json": _SIMULATED,
    "threads.json": ("bench", "gym", "policies", "training", *_SIMULATED),
    "viewer.json": ("viewer",),
    "writing.json": ("episodes", "workers"),
}


def parts_of(name: str) -> list[str]:
    """The parts of the package that a file in `results` depends on.

    Raises:
      KeyError: the table above lacks the file.
    """
    pattern = next((one for one in _PARTS if fnmatch.fnmatchcase(name, one)), None)
    if pattern is None:
        raise KeyError(f"{name}: name the parts that it depends on in {__file__}")
    domain = Path(name).name.partition("-")[0]
    return [part.format(domain=domain) for part in _PARTS[pattern]]


def fingerprint(parts: Iterable[str], package: Path = _PACKAGE) -> str:
    """SHA-256 of the names and contents of all code and models in parts of a package, in hex."""
    found: set[Path] = set()
    for part in parts:
        for path in package.glob(part):
            found |= {path} if path.is_file() else {*path.rglob("*.py"), *path.rglob("*.xml")}
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(f"{path.relative_to(package).as_posix()}\n".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def outdated(results: Path = RESULTS, package: Path = _PACKAGE) -> list[str]:
    """The files whose sources have changed since they were measured, in order."""
    known = json.loads((results / _LEDGER).read_text(encoding="utf-8"))
    return [
        name
        for name in names(results)
        if known.get(name, {}).get("sha256") != fingerprint(parts_of(name), package)
    ]


def names(results: Path = RESULTS) -> list[str]:
    """The files of results, relative to their folder."""
    found = (path.relative_to(results).as_posix() for path in results.rglob("*") if path.is_file())
    return sorted(name for name in found if name != _LEDGER)


def record(name: str, results: Path = RESULTS, package: Path = _PACKAGE) -> None:
    """Records the present sources for a file that has just been measured."""
    ledger = results / _LEDGER
    known = json.loads(ledger.read_text(encoding="utf-8")) if ledger.exists() else {}
    parts = parts_of(name)
    known[name] = {"parts": parts, "sha256": fingerprint(parts, package)}
    text = json.dumps(dict(sorted(known.items())), indent=1)
    ledger.write_text(f"{text}\n", encoding="utf-8")


def write(file: Path, content: Any) -> None:  # Any: values of JSON
    """Writes the results of a measurement, with the sources if they are for `results`.

    Raises:
      ValueError: a number is infinite or not a number.
    """
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    # Lists of numbers are on one line each.
    text = re.sub(r"\[[-\d\s.,e+]*\]", lambda found: " ".join(found[0].split()), text)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, text)
    if file.resolve().is_relative_to(RESULTS):
        record(file.resolve().relative_to(RESULTS).as_posix())


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        record(argument)
    if len(sys.argv) == 1:
        print("\n".join(outdated()))
