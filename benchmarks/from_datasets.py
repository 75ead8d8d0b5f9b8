"""Scores of the policies that the examples learn from datasets, with three seeds each.

    python benchmarks/from_datasets.py [--json FILE]

It runs examples/behaviour_cloning.py and examples/offline_iql.py with their own settings, and
behaviour cloning of the dataset of the second one too, and reads the mean returns that they print.
It needs the extras `torch` and `torchrl`. README.md describes the comparison.
"""

import json
import re
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from limberjack.mujoco.fingerprint import versions

__all__ = ["main", "returns_in"]

_EXAMPLES = Path(__file__).parents[1] / "examples"
# The example that learns, and the one that collects the dataset.
_RUNS = (
    ("behaviour_cloning", "behaviour_cloning"),
    ("offline_iql", "offline_iql"),
    ("behaviour_cloning", "offline_iql"),
)
_SEEDS = range(3)
_PACKAGES = ("torch", "torchrl")


def returns_in(printed: str) -> tuple[float, float]:
    """The mean returns of the dataset and of the learned policy that an example has printed.

    Raises:
      ValueError: it has printed none.
    """
    found = re.search(
        r"^return of the dataset ([\d.]+), of the .* ([\d.]+)$", printed, re.MULTILINE
    )
    if found is None:
        raise ValueError(f"no returns in what the example printed: {printed!r}")
    return float(found[1]), float(found[2])


def _run(example: str, folder: Path, seed: int) -> tuple[float, float]:
    """The mean returns of a dataset, and of the policy that an example learned from it."""
    arguments = [str(_EXAMPLES / f"{example}.py"), "--data", str(folder), "--seed", str(seed)]
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed: {done.stderr}")
    return returns_in(done.stdout)


def main(
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the figures here.")
    ] = None,
) -> None:
    """Run the examples and print a table."""
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        # The datasets first: the second example's is there when the first one learns from it.
        for example, collector in _RUNS:
            found = [_run(example, Path(temporary) / collector, seed) for seed in _SEEDS]
            row = {
                "example": example,
                "dataset": collector,
                "return_of_dataset": found[0][0],
                "returns": [learned for _, learned in found],
            }
            rows.append(row)
            typer.echo(row)
    content = {
        "seeds": [_SEEDS.start, _SEEDS.stop],
        "versions": {**versions(), **{name: version(name) for name in _PACKAGES}},
        "rows": rows,
    }
    if json_file is not None:
        json_file.write_text(f"{json.dumps(content, indent=1)}\n", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
