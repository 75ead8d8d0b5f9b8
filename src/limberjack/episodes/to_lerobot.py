"""`to_lerobot`: a dataset in version 3 of LeRobot's format.

    to_lerobot(load("walk"), "walk/lerobot")
    # LeRobotDataset("limberjack/walker-walk", root="walk/lerobot"), in an environment of lerobot

A frame is a step: the observations before it, joined into `observation.state`, its action, reward
and end, all of them float32, as LeRobot's policies expect. So the frames train, but do not replay,
and the last observation of an episode, states and model fields stay in Limberjack's own files.
Pixels are `observation.images.pixels`, as PNG: of a stack of pictures, or of those of several
cameras, the last one (three channels). Where only pixels are observed, frames have no
`observation.state`. Observations that `Dataset.select` leaves out are neither in the frames nor in
the statistics. A file of frames has the episodes of a file of the dataset.

This module needs no lerobot, whose requirements exclude those of Limberjack.
"""

import itertools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from limberjack.episodes.column_statistics import Spread
from limberjack.episodes.converting import converted
from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode
from limberjack.episodes.parquet import Plain, write_plain
from limberjack.episodes.places import local
from limberjack.episodes.recipe import OBSERVATION, PIXELS
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.utils import png
from limberjack.utils.facts import title_of
from limberjack.workers import OnProgress

__all__ = ["to_lerobot"]

_VERSION = "v3.0"  # of the format
_IMAGES = "observation.images.pixels"
_CHANNELS = 3  # of a picture: red, green, blue
_STATE, _ACTION, _REWARD = "observation.state", "action", "next.reward"
_PER_CHUNK = 1000  # files of a folder
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA, _EPISODES = f"data/{_FILE}", f"meta/episodes/{_FILE}"
_RECIPE = "meta/limberjack.json"
_MOMENTS = ("min", "max", "mean", "std")
_QUANTILES = {"q01": 0.01, "q50": 0.5, "q99": 0.99}  # LeRobot's names of those that are known
# Columns of every frame besides those of the task, with their types.
_PLACE = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
# pandas takes the text of a task as the index of the table of tasks.
_TASK_COLUMNS = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}


def to_lerobot(dataset: Dataset, folder: Path | str, on_progress: OnProgress | None = None) -> None:
    """Writes a dataset in LeRobot's format.

    Args:
      dataset: of any environment; its observations are those that `select` has chosen.
      folder: to be created; an earlier conversion is replaced.
      on_progress: called after each episode, as by `limberjack.evaluation.evaluate`.

    Raises:
      ValueError: the folder has something else, or a file is damaged; nothing is left of the new
        one.
      OSError: a file cannot be written.
    """
    with converted(local(folder).resolve(), _is_ours) as partial:
        _write(dataset, partial, on_progress)


def _is_ours(folder: Path) -> bool:
    """Whether a folder has a dataset that `to_lerobot` wrote, and nothing else."""
    names = ("data", "meta")
    if folder.is_symlink() or not folder.is_dir() or sorted(os.listdir(folder)) != [*names]:
        return False
    return (folder / _RECIPE).is_file() and not any((folder / name).is_symlink() for name in names)


def _write(dataset: Dataset, folder: Path, on_progress: OnProgress | None) -> None:
    episodes = _episodes(dataset)
    firsts = episodes["dataset_from_index"]
    timestep = dataset.recipe.facts["control_timestep"]
    numbers = itertools.count()

    def tables(file: int) -> Iterator[Mapping[str, Plain]]:
        # The episodes first: at the end of a file `zip` takes no number for nothing.
        for episode, number in zip(dataset.selected_of(file), numbers, strict=False):
            yield _frames(episode, number, int(firsts[number]), timestep)
            if on_progress is not None:
                on_progress("converting", number + 1, 0.0)

    for file in range(len(dataset.shards)):
        write_plain(_made(folder, _DATA, file), tables(file))
    title = title_of(dataset.recipe.facts)
    listed: dict[str, Plain] = {**episodes, "tasks": [[title]] * len(dataset)}
    write_plain(_made(folder, _EPISODES, 0), [listed])
    tasks: dict[str, Plain] = {"task_index": np.zeros(1, np.int64), "task": [title]}
    write_plain(folder / "meta/tasks.parquet", [tasks], {"pandas": _pandas()})
    for name, content in (
        ("meta/info.json", _info(dataset)),
        ("meta/stats.json", _statistics(dataset)),
        (_RECIPE, dataset.recipe.as_json()),
    ):
        (folder / name).write_text(f"{json.dumps(content, indent=1)}\n", encoding="utf-8")


def _episodes(dataset: Dataset) -> dict[str, np.ndarray]:
    """The places of the episodes, (episodes,), by the names of LeRobot's columns."""
    lengths = np.array(dataset.lengths)
    ends = np.cumsum(lengths)
    starts = [shard.seeds.start for shard in dataset.shards]
    files = np.searchsorted(starts, dataset.seeds, side="right") - 1
    none = np.zeros(len(lengths), np.int64)
    return {
        "episode_index": np.arange(len(lengths)),
        "length": lengths,
        "data/chunk_index": files // _PER_CHUNK,
        "data/file_index": files % _PER_CHUNK,
        "meta/episodes/chunk_index": none,
        "meta/episodes/file_index": none,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
    }


def _made(folder: Path, form: str, number: int) -> Path:
    """The path of a file in a folder that is there."""
    chunk, file = divmod(number, _PER_CHUNK)
    path = folder / form.format(chunk_index=chunk, file_index=file)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _frames(episode: Episode, number: int, first: int, timestep: float) -> dict[str, Plain]:
    """The frames of an episode by the names of their columns."""
    steps = np.arange(episode.length)
    joined = {
        _STATE: _joined(list(_numbers(episode).values()), episode.length),
        _ACTION: _joined([episode.actions], episode.length),
    }
    found: dict[str, Plain] = {
        **{name: values for name, values in joined.items() if values.size},
        _REWARD: episode.rewards.astype(np.float32),
        "next.done": episode.terminated | episode.truncated,
        "next.terminated": episode.terminated,
    }
    if PIXELS_KEY in episode.observations:
        pictures = [one[..., -_CHANNELS:] for one in episode.observations[PIXELS_KEY][:-1]]
        found[_IMAGES] = [*map(png.encode, pictures)]
    if episode.success is not None:
        found["next.success"] = episode.success
    places = (steps * timestep, steps, steps * 0 + number, steps + first, steps * 0)
    for (name, dtype), values in zip(_PLACE.items(), places, strict=True):
        found[name] = values.astype(dtype)
    return found


def _numbers(episode: Episode) -> dict[str, np.ndarray]:
    """The observations without pixels."""
    return {name: values for name, values in episode.observations.items() if name != PIXELS_KEY}


def _joined(parts: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """The numbers of the first rows of some arrays beside each other, (rows, n)."""
    none = np.empty((rows, 0), bool)  # whose type changes no other's
    flat = [part[:rows].reshape(rows, -1) if part.size else none for part in parts]
    return np.concatenate([none, *flat], axis=1).astype(np.float32)


def _info(dataset: Dataset) -> dict[str, object]:
    """The content of info.json."""
    facts = dataset.recipe.facts
    rate = round(1 / facts["control_timestep"], 6)  # frames a second
    return {
        "codebase_version": _VERSION,
        "robot_type": facts.get("domain"),
        "fps": int(rate) if rate == int(rate) else rate,
        "features": _features(dataset),
        "total_episodes": len(dataset),
        "total_frames": dataset.steps,
        "total_tasks": 1,
        "chunks_size": _PER_CHUNK,
        "splits": {"train": f"0:{len(dataset)}"},
        "data_path": _DATA,
        "video_path": None,
    }


def _features(dataset: Dataset) -> dict[str, dict[str, object]]:
    """The type, the shape and the names of the numbers of each column of the frames."""
    columns = {column.name: column for column in dataset.recipe.columns}
    chosen = [columns[OBSERVATION + name] for name in dataset.observed]
    observed = [c for c in chosen if c.size and c.name != PIXELS]
    parts = {
        _STATE: [
            f"{c.name.removeprefix(OBSERVATION)}.{number}"
            for c in observed
            for number in range(c.size)
        ],
        _ACTION: [f"{number}" for number in range(columns["action"].size)],
    }
    features = {n: _feature("float32", len(names), names) for n, names in parts.items() if names}
    features[_REWARD] = _feature("float32")
    features |= {name: _feature("bool") for name in ("next.done", "next.terminated")}
    if columns.get(PIXELS) in chosen:
        shape, names = [*columns[PIXELS].shape[:2], _CHANNELS], ["height", "width", "channels"]
        features[_IMAGES] = {"dtype": "image", "shape": shape, "names": names}
    if "success" in columns:
        features["next.success"] = _feature("bool")
    return features | {name: _feature(dtype) for name, dtype in _PLACE.items()}


def _feature(dtype: str, size: int = 1, names: Sequence[str] | None = None) -> dict[str, object]:
    return {"dtype": dtype, "shape": [size], "names": names}


def _statistics(dataset: Dataset) -> dict[str, object]:
    """The content of stats.json; the last observation of each episode counts here."""
    found = dataset.statistics()
    columns = {
        _STATE: list(found.observations.values()),
        _ACTION: [found.actions],
        _REWARD: [found.rewards],
    }
    has_numbers = {name: any(one.mean.size for one in parts) for name, parts in columns.items()}
    return {name: _spreads(parts) for name, parts in columns.items() if has_numbers[name]}


def _spreads(parts: Sequence[Spread]) -> dict[str, list[float]]:
    """The statistics of some columns, joined."""

    def joined(values: Sequence[np.ndarray]) -> list[float]:
        return np.concatenate([np.reshape(one, -1) for one in values]).tolist()

    moments = {name: joined([getattr(part, name) for part in parts]) for name in _MOMENTS}
    quantiles = {
        name: joined([part.quantiles[q] for part in parts]) for name, q in _QUANTILES.items()
    }
    return {**moments, **quantiles, "count": [parts[0].count]}


def _pandas() -> str:
    """The metadata by which pandas reads the table of tasks."""
    columns = [
        {
            "name": name,
            "field_name": name,
            "pandas_type": kind,
            "numpy_type": numpy,
            "metadata": None,
        }
        for name, (kind, numpy) in _TASK_COLUMNS.items()
    ]
    content = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    return json.dumps(content)
