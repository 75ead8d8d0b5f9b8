"""Scores of the policies that the examples learn from datasets, with three seeds each.

    python benchmarks/from_datasets.py

It runs examples/behaviour_cloning.py and examples/offline_iql.py with their own settings, and
behaviour cloning of the dataset of the second one too, and reads the mean returns that they print.
It writes results/from_datasets.json and the table of docs/datasets.md, and needs the extras `torch`
and `torchrl`. README.md describes the comparison.
"""

import re
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pages
import sources

from limberjack.mujoco.fingerprint import versions

__all__ = ["main", "returns_in", "section"]

_ROOT = Path(__file__).parents[1]
_EXAMPLES = _ROOT / "examples"
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
    form = r"^return of the dataset ([\d.]+), of the .* ([\d.]+)$"
    found = re.search(form, printed, re.MULTILINE)
    if found is None:
        raise ValueError(f"no returns in what the example printed: {printed!r}")
    return float(found[1]), float(found[2])


def section(content: Any) -> str:  # Any: what was read from JSON
    """The table of the page."""
    columns = ["example", "dataset of", "return of the dataset", "of the policies of three seeds"]
    rows = [
        [
            *(f"`{row[name]}.py`" for name in ("example", "dataset")),
            f"{row['return_of_dataset']:.0f}",
            ", ".join(f"{mean:.0f}" for mean in row["returns"]),
        ]
        for row in content["rows"]
    ]
    return "\n".join(["", *pages.table(columns, rows), "", ""])


def _run(example: str, folder: Path, seed: int) -> tuple[float, float]:
    """The mean returns of a dataset, and of the policy that an example learned from it."""
    arguments = [str(_EXAMPLES / f"{example}.py"), "--data", str(folder), "--seed", str(seed)]
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed: {done.stderr}")
    return returns_in(done.stdout)


def main() -> None:
    """Run the examples and write what they learned."""
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        # The second example collects the dataset that the third run learns from.
        for example, collector in _RUNS:
            found = [_run(example, Path(temporary) / collector, seed) for seed in _SEEDS]
            rows.append(
                {
                    "example": example,
                    "dataset": collector,
                    "return_of_dataset": found[0][0],
                    "returns": [learned for _, learned in found],
                }
            )
            print(rows[-1], flush=True)
    content = {
        "seeds": [_SEEDS.start, _SEEDS.stop],
        "versions": {**versions(), **{name: version(name) for name in _PACKAGES}},
        "rows": rows,
    }
    sources.write(sources.RESULTS / "from_datasets.json", content)
    page = _ROOT / "docs" / "datasets.md"
    pages.write_section(page, "learned from datasets", "from_datasets.py", section(content))


if __name__ == "__main__":
    main()
