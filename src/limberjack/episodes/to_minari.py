"""`to_minari`: a dataset in Minari's format, which Gymnasium's users load.

    name = to_minari(load("walk"), "minari")    # 'limberjack/humanoid-walk/random-v0'
    # MINARI_DATASETS_PATH=minari python -c "import minari; minari.load_dataset('...')"

Episodes are copied one at a time, with Arrow storage and without Minari's collector, which needs
JAX. Actions are float64, so that `recover_environment()`, stepped with an episode's seed and
actions, gives the same observations and rewards. Pixels, states and model fields have no place
there.

This is the only module that imports minari.
"""

import contextlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack.episodes.converting import converted
from limberjack.episodes.dataset import Dataset
from limberjack.episodes.places import local
from limberjack.episodes.recipe import environments_of
from limberjack.gym.made import spec_of
from limberjack.gym.observations import Observations, action_space
from limberjack.rl.action_specs import spec_of as spec_of_actions
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.rl.row_step import as_mapping
from limberjack.utils.files import read_regular
from limberjack.utils.requirements import missing_extra
from limberjack.workers import OnProgress

try:
    import minari  # pyright: ignore[reportMissingImports]
    from minari.data_collector import EpisodeBuffer  # pyright: ignore[reportMissingImports]
    from minari.dataset.minari_storage import (  # pyright: ignore[reportMissingImports]
        MinariStorage,
    )
except ImportError as error:
    raise missing_extra("minari") from error

__all__ = ["to_minari"]

_STORAGE = "arrow"
_RECIPE = "limberjack"  # entry of the metadata
_REQUIRED = ("limberjack", "mujoco")  # packages that make the environment
_METADATA = "metadata.json"  # beside it, Minari has a folder per episode, named by its number


def to_minari(
    dataset: Dataset,
    root: Path | str,
    name: str | None = None,
    on_progress: OnProgress | None = None,
) -> str:
    """Writes a dataset below a folder of Minari datasets, and returns its id.

    An earlier conversion of that id is replaced.

    Args:
      dataset: of a domain that is known here.
      root: the folder, which MINARI_DATASETS_PATH must name to load it; created if needed.
      name: the id; by default of domain, task and policy.
      on_progress: called after each episode, as by `limberjack.evaluation.evaluate`.

    Raises:
      ValueError: there is another dataset of that id, it is no id, or a file is damaged; nothing is
        left of the new one.
      OSError: a file cannot be written.
      ImportError: the extra `minari` is missing.
    """
    facts = dataset.recipe.facts
    if "domain" not in facts:
        raise ValueError(
            f"the episodes are those of environments that {facts['environment']} makes; Minari's "
            "format needs an environment that Gymnasium makes by its id"
        )
    if name is None:
        policy = re.sub(r"[^\w]+", "_", facts["policy"])
        name = f"limberjack/{facts['domain']}-{facts['task']}/{policy}-v0"
    if not re.fullmatch(r"([-\w]+/)*[-\w]+-v\d+", name):
        raise ValueError(f"the id is {name!r}; expected one such as 'mine/walk-v0'")
    folder = local(root).resolve() / name  # Minari takes no relative path
    with converted(folder, _is_ours, "another folder or id") as partial:
        _write(dataset, partial / "data", name, on_progress)
    return name


def _is_ours(folder: Path) -> bool:
    """Whether a folder has one converted dataset of `limberjack collect`, and nothing else."""
    data = folder / "data"
    try:
        if folder.is_symlink() or data.is_symlink() or os.listdir(folder) != [data.name]:
            return False
        if not all(one.name == _METADATA or one.name.isdecimal() for one in data.iterdir()):
            return False
        return _RECIPE in json.loads(read_regular(data / _METADATA))
    except (OSError, TypeError, ValueError):
        return False


def _write(dataset: Dataset, path: Path, name: str, on_progress: OnProgress | None) -> None:
    recipe = dataset.recipe
    facts, kept = recipe.facts, recipe.kept
    dtype = "float32" if kept.float32 else "float64"
    environment, _ = environments_of(recipe)
    with contextlib.closing(environment):
        observed = Observations(_observed(environment), kept.flat, dtype)
        actions = action_space(spec_of_actions(environment), "float64")
    how = {"flat": kept.flat, "dtype": dtype, **(facts.get("world") or {})}
    spec = spec_of(facts["domain"], facts["task"], recipe.step_limit, **how)
    path.mkdir(parents=True)
    storage = MinariStorage.new(path, observed.space, actions, spec, _STORAGE, jpeg_encoding=False)
    storage.update_metadata(
        {
            "dataset_id": name,
            "minari_version": minari.__version__,
            "algorithm_name": facts["policy"],
            # With other versions `recover_environment()` warns, as numbers may differ.
            "requirements": [f"{name}=={facts['versions'][name]}" for name in _REQUIRED],
            _RECIPE: recipe.facts,
        }
    )
    storage.update_episodes(_buffers(dataset, observed, on_progress))


def _observed(environment: dm_env.Environment) -> Mapping[str, specs.Array]:
    """The specs of the observations, by name."""
    return cast(Mapping[str, specs.Array], as_mapping(environment.observation_spec()))


def _buffers(
    dataset: Dataset,
    observed: Observations,
    on_progress: OnProgress | None,
) -> Iterator[EpisodeBuffer]:
    """The episodes, in Minari's form."""
    for number, episode in enumerate(dataset):
        observations = {
            name: np.asarray(values, observed.dtype)
            for name, values in episode.observations.items()
            if name != PIXELS_KEY  # the environment that is recovered draws none
        }
        # Any: it wants lists for which its storage takes arrays.
        values: dict[str, Any] = {
            "observations": observations[FLAT_OBSERVATION_KEY] if observed.flat else observations,
            "actions": episode.actions,
            "rewards": episode.rewards,
            "terminations": episode.terminated,
            "truncations": episode.truncated,
        }
        yield EpisodeBuffer(id=number, seed=episode.seed, **values)
        if on_progress is not None:
            on_progress("converting", number + 1, 0.0)
