"""The notebooks run from top to bottom, show pictures, and are committed without outputs.

Their cells run in one namespace in a process of their own, as in a kernel. A cell with the tag
`parameters` is replaced, so that what takes minutes takes seconds.
"""

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

from tests.warm import run

_NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
_NEEDS = {"train_and_watch": ("sbx", "stable_baselines3", "torch")}  # of the extra `train`

# Prints the tag of the HTML that each cell shows, after what the cells print.
_EXECUTE = """
import ast, json, sys
names, shown = {"__name__": "__main__"}, []
for source in json.loads(sys.argv[1]):
    cell = ast.parse(source)
    last = cell.body.pop() if isinstance(cell.body[-1], ast.Expr) else None
    exec(compile(cell, "cell", "exec"), names)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        shown += [value._repr_html_().split()[0]] if hasattr(value, "_repr_html_") else []
print(*shown)
"""

# Instead of the parameters: a short run, and two of the twenty evaluations, which take most of it.
_SHORT = """
from importlib import import_module
import_module("limberjack.training.run")._EVALUATIONS = 2
domain, task, out, steps = "cartpole", "swingup", {folder!r}, 4_800
"""

# By notebook: a line that it prints, and what its cells show.
_EXPECTED = {
    "distractors": ("(20, 6) True", "<img <video"),
    "first_steps": ("(9,) True", "<img <video <img"),
    "many_tasks": ("(6, 24) (6, 6) [0 0 1 1 2 2]", "<img <video"),
    "train_and_watch": ("mean return", "<img <video"),
}


def _cells(path: Path) -> list[dict[str, Any]]:  # Any: what JSON holds
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("path", _NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_top_to_bottom_and_shows_pictures(path: Path, tmp_path: Path) -> None:
    needed = _NEEDS.get(path.stem, ())
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"needs the extra 'train': {', '.join(missing)} not installed")
    code = [cell for cell in _cells(path) if cell["cell_type"] == "code"]
    sources = ["".join(cell["source"]) for cell in code]
    for number, cell in enumerate(code):
        if "parameters" in cell["metadata"].get("tags", ()):
            sources[number] = _SHORT.format(folder=str(tmp_path / "run"))
    # Libraries of training warn of each other.
    printed = run(_EXECUTE, json.dumps(sources), warnings="ignore" if needed else "error")
    line, shown = _EXPECTED[path.stem]
    assert line in printed
    assert printed.splitlines()[-1] == shown


def test_every_notebook_is_known_and_has_no_outputs() -> None:
    assert [path.stem for path in _NOTEBOOKS] == sorted(_EXPECTED)
    for path in _NOTEBOOKS:
        for cell in _cells(path):
            assert not cell.get("outputs"), path
            assert cell.get("execution_count") is None, path
