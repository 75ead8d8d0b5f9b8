"""`Demonstrations`: actions of a dataset's episodes, as a learner of other actions needs them.

shown = demonstrations_of(dataset, layout, action_repeat=2, low=low, high=high)
shown.observations      # (N, n), before each action
shown.rewards           # (N,), summed over the control steps of each action
"""

import hashlib
import json
from typing import NamedTuple

import numpy as np

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode
from limberjack.policies import mlp

__all__ = ["Demonstrations", "check_of_task", "demonstrations_of", "identity_of"]


class Demonstrations(NamedTuple):
    """N actions, in the order of the episodes.

    Attributes:
      observations: before each action, (N, n) float32.
      next_observations: after its control steps, likewise.
      actions: (N, nu) float32, in the environment's units and within its bounds.
      rewards: summed over the control steps, (N,) float32.
      is_last: whether the episode ended with it, (N,).
      is_truncated: whether the time limit did, (N,).
    """

    observations: np.ndarray
    next_observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    is_last: np.ndarray
    is_truncated: np.ndarray


def demonstrations_of(
    dataset: Dataset, layout: mlp.Layout, action_repeat: int, low: np.ndarray, high: np.ndarray
) -> Demonstrations:
    """The episodes as if each action had been held for several control steps.

    Such an action is the mean of the actions of these steps, between the bounds. The observations
    and rewards are those that were seen.

    Args:
      dataset: its episodes were played with any action repeat.
      layout: names and shapes of the observations, in the order of the network's input.
      action_repeat: control steps for which the learner holds an action.
      low, high: bounds of an action, (nu,) each.

    Raises:
      ValueError: the dataset lacks an observation, or has other shapes, or a file is damaged.
    """
    parts = [_of_episode(episode, layout, action_repeat, low, high) for episode in dataset]
    return Demonstrations(*map(np.concatenate, zip(*parts, strict=True)))


def _of_episode(
    episode: Episode, layout: mlp.Layout, repeat: int, low: np.ndarray, high: np.ndarray
) -> Demonstrations:
    first = np.arange(0, episode.length, repeat)
    last = np.minimum(first + repeat, episode.length)  # its end may cut an action short
    if episode.actions.shape[1:] != low.shape:
        raise ValueError(
            f"demonstrations have actions of shape {episode.actions.shape[1:]}; expected "
            f"{low.shape}, as the environment's"
        )
    _check_observations(episode, layout)
    seen = mlp.flattened(layout, episode.observations)  # (T + 1, n)
    actions = np.add.reduceat(episode.actions, first) / (last - first)[:, None]
    ends = last == episode.length
    return Demonstrations(
        seen[first],
        seen[last],
        np.clip(actions, low, high).astype(np.float32),
        np.add.reduceat(episode.rewards, first).astype(np.float32),
        ends,
        ends & bool(episode.truncated[-1]),
    )


def _check_observations(episode: Episode, layout: mlp.Layout) -> None:
    for name, shape in layout:
        seen = episode.observations.get(name)
        if seen is None or seen.shape[1:] != shape:
            found = "no observation" if seen is None else f"shape {seen.shape[1:]} of"
            raise ValueError(
                f"demonstrations have {found} {name!r}; expected shape {shape}, as the "
                "environment's: collect them in the same task"
            )


def check_of_task(dataset: Dataset, domain: str | None, task: str | None) -> None:
    """Raises ValueError if the dataset and the run have names of tasks, and they are different."""
    facts = dataset.recipe.facts
    if domain is None or "domain" not in facts:
        return
    if (facts["domain"], facts["task"]) != (domain, task):
        raise ValueError(
            f"demonstrations are of {facts['domain']} {facts['task']}; expected those of {domain} "
            f"{task}"
        )


def identity_of(dataset: Dataset) -> dict[str, object]:
    """Values of JSON that distinguish a dataset from others."""
    named = [dataset.seeds, dataset.sha256(), dataset.observed]
    digest = hashlib.sha256(json.dumps(named, sort_keys=True).encode())
    return {"episodes": len(dataset), "sha256": digest.hexdigest()}
