"""Small datasets, and what the tests of several modules do with them."""

import contextlib
import dataclasses
import hashlib
from pathlib import Path

import numpy as np

from limberjack import policies, suite
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.parquet import PYARROW
from limberjack.episodes.playing import batch_for, play
from limberjack.episodes.recipe import Recipe, recipe_of
from limberjack.episodes.starts import Starts
from limberjack.workers import prepare

__all__ = ["ARM", "EVERYTHING", "PENDULUM", "assert_equal", "hashes", "made"]

PENDULUM = ("pendulum", "swingup", 0.2)  # 10 steps; neither kinds of starts nor model fields
ARM = ("manipulator", "bring_ball", 0.05)  # 5 steps; kinds of starts, and two model fields
EVERYTHING = Kept(states=True, float32=True, flat=True)

_Task = tuple[str, str, float]


def made(
    where: _Task, seeds: range, kept: Kept | None = None, policy: str = "random"
) -> tuple[Recipe, list[Episode]]:
    """The recipe and the episodes of a policy."""
    domain, task, seconds = where
    kept = kept or Kept()
    setup = prepare(domain, task, policy, time_limit=seconds)
    environment = suite.load(domain, task, {"random": 0, "time_limit": seconds})
    versions = {**setup.identity["versions"], "pyarrow": PYARROW}
    recipe = recipe_of({**setup.identity, "versions": versions}, environment, kept)
    actor = policies.find(policy, environment)
    starts = Starts(setup.opened().full_build)
    with contextlib.closing(batch_for(environment, actor, len(seeds), 1)) as batch:
        played = [e for ended in play(batch, actor, seeds, kept) for e in ended]
    ordered = sorted(played, key=lambda episode: episode.seed)
    return recipe, [dataclasses.replace(e, start=starts.kind(e.seed)) for e in ordered]


def hashes(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file of a dataset, by name."""
    paths = sorted(folder.glob("seeds-*.parquet"))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def assert_equal(one: Episode, other: Episode) -> None:
    """Compares every bit of two episodes."""
    for field in dataclasses.fields(Episode):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(ours, dict):
            assert list(ours) == list(theirs)
            for name in ours:
                _assert_same(ours[name], theirs[name], name)
        else:
            _assert_same(ours, theirs, field.name)


def _assert_same(one: object, other: object, name: str) -> None:
    if not isinstance(one, np.ndarray):
        assert one == other, name
        return
    assert isinstance(other, np.ndarray), name
    assert (one.dtype, one.shape) == (other.dtype, other.shape), name
    assert one.tobytes() == other.tobytes(), name
