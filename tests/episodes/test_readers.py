"""Programs that read Parquet files open the folder `episodes` of a dataset by its name.

Those that are not installed are skipped; Hugging Face `datasets` and Ray are too heavy for the
extra `test`.
"""

import functools
import importlib
import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from limberjack.data import Kept, collect

from .collected import ARM, of_64


@functools.cache
def _installed(name: str) -> Any:  # a module, which may be missing
    return pytest.importorskip(name, reason=f"needs {name}")


def _pandas(folder: Path) -> dict[str, list[Any]]:
    table = _installed("pandas").read_parquet(folder / "episodes")
    assert table["reward"].isna().tolist() == table["is_last"].tolist()
    return {name: list(table[name]) for name in ("seed", "reward", "action", "is_last")} | {
        "sum": [table["reward"].sum()]
    }


def _pyarrow(folder: Path) -> dict[str, list[Any]]:
    _installed("pyarrow")
    import pyarrow.compute as pc
    import pyarrow.dataset as ds

    table = ds.dataset(folder / "episodes").to_table()
    total = pc.call_function("sum", [table["reward"]])
    return {**table.to_pydict(), "sum": [total.as_py()]}


def _polars(folder: Path) -> dict[str, list[Any]]:
    table = _installed("polars").read_parquet(folder / "episodes")
    return {**table.to_dict(as_series=False), "sum": [table["reward"].sum()]}


def _duckdb(folder: Path) -> dict[str, list[Any]]:
    duckdb = _installed("duckdb")
    names = ("seed", "reward", "action", "is_last")
    source = f"read_parquet('{folder / 'episodes'}/*.parquet')"
    rows = duckdb.sql(f"select {', '.join(names)} from {source} order by seed, step").fetchall()
    ((total,),) = duckdb.sql(f"select sum(reward) from {source}").fetchall()
    return {**dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)), "sum": [total]}


def _datasets(folder: Path) -> dict[str, list[Any]]:
    found = _installed("datasets").load_dataset(
        str(folder), split="train", cache_dir=str(folder.parent / "cache")
    )
    table = {name: list(found[name]) for name in ("seed", "reward", "action", "is_last")}
    return {**table, "sum": [sum(value for value in table["reward"] if value is not None)]}


def _ray(folder: Path) -> dict[str, list[Any]]:
    ray = _installed("ray")
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore")  # Ray warns of options that it sets itself
        patch.setenv("RAY_AUTH_MODE", "disabled")  # with a token it writes into the home folder
        ray_data = importlib.import_module("ray.data")

        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
        try:
            found = ray_data.read_parquet(str(folder / "episodes"))
            rows = sorted(found.take_all(), key=lambda row: (row["seed"], row["step"]))
            total = found.sum("reward")
        finally:
            ray.shutdown()
    return {name: [row[name] for row in rows] for name in rows[0]} | {"sum": [total]}


_READERS = {
    "duckdb": _duckdb,
    "datasets": _datasets,
    "pandas": _pandas,
    "polars": _polars,
    "pyarrow": _pyarrow,
    "ray": _ray,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two files, with kinds of starts, states and model fields."""
    folder = tmp_path_factory.mktemp("readers") / "data"
    domain, task, seconds = ARM
    kept = Kept(states=True)
    how = {"time_limit": seconds, "num_threads": 1, "file_mb": of_64(ARM, kept)}
    collect(domain, task, "random", range(62, 66), out=folder, kept=kept, **how)
    return folder


@pytest.mark.parametrize("read", _READERS.values(), ids=_READERS)
def test_a_reader_finds_every_row_and_the_returns(
    read: Callable[[Path], dict[str, list[Any]]], folder: Path
) -> None:
    manifest = json.loads((folder / "dataset.json").read_text())
    returns = [value for file in manifest["files"] for value in file["returns"]]
    assert len(manifest["files"]) == 2
    table = read(folder)
    assert table["seed"] == [seed for seed in range(62, 66) for _ in range(6)]
    assert table["is_last"] == [step == 5 for _ in range(4) for step in range(6)]
    assert math.isclose(table["sum"][0], sum(returns), rel_tol=1e-9)
    assert [action is None for action in table["action"]] == table["is_last"]
    assert {len(action) for action in table["action"] if action is not None} == {5}
