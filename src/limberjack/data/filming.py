"""`film`: an episode of a dataset as a film, from its states, or from its seed and actions.

    film(load("walk"), 3, out="walk-3.mp4", overlay=True)

States are shown as they were recorded, with any version of MuJoCo. Without them the episode is
simulated again, and a film of other rewards than the recorded ones is refused.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from limberjack.data.dataset import Dataset
from limberjack.data.episode import Episode
from limberjack.data.recipe import Recipe
from limberjack.data.replaying import environment_of, other_versions
from limberjack.recording.films import record, record_states

__all__ = ["film"]

# Called with steps so far, steps in all and the return so far.
_OnProgress = Callable[[int, int, float], object]


# Arguments of `record`, which checks them.
def film(
    dataset: Dataset,
    seed: int,
    *,
    out: Path | str,
    on_progress: _OnProgress | None = None,
    **view: Any,  # arguments of `render`, each with its own type
) -> Path:
    """Films the episode of a seed.

    Args:
      dataset: of a domain that is known here.
      seed: of the episode.
      out: the file, which ends in .mp4 or .gif.
      on_progress: called before the episode begins and after each step.
      view: `camera`, `height`, `width`, `overlay` and `visualize_reward` of `record`.

    Raises:
      ValueError: there is no such episode, it is another one here, or see `record`.
      ImportError, OSError, PhysicsError, RenderingError: see `record`.
    """
    if seed not in dataset.seeds:
        raise ValueError(f"there is no episode of seed {seed}; the first is {dataset.seeds[0]}")
    episode, recipe = dataset.episode(seed), dataset.recipe
    facts = recipe.facts
    if episode.states is not None:
        environment = environment_of(recipe)
        environment.reseed(seed)
        environment.reset()  # draws the model fields
        return record_states(
            environment, episode.states, episode.rewards, out=out, on_progress=on_progress, **view
        )

    # Half a step less, so that rounding does not add one.
    seconds = (episode.length - 0.5) * facts["control_timestep"]
    where = facts["domain"], facts["task"]
    checked = _checking(episode, recipe, on_progress)
    policy = _Again(episode)
    return record(
        *where, out=out, policy=policy, seed=seed, seconds=seconds, on_progress=checked, **view
    )


def _checking(episode: Episode, recipe: Recipe, on_progress: _OnProgress | None) -> _OnProgress:
    """A function that raises ValueError if the last step has another return than the episode."""

    def checked(step: int, steps: int, total: float) -> None:
        if step == episode.length and total != episode.total:
            raise ValueError(
                f"the episode of seed {episode.seed} has return {total} here, and {episode.total} "
                "in the dataset: with --states it could be filmed with other versions."
                f"{other_versions(recipe, None)}"
            )
        if on_progress is not None:
            on_progress(step, steps, total)

    return checked


class _Again:
    """The policy that returns an episode's actions."""

    def __init__(self, episode: Episode) -> None:
        self._actions = episode.actions
        self._step = 0

    def reset(self) -> None:
        """Begins with the first action."""
        self._step = 0

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """The next action."""
        self._step += 1
        return self._actions[self._step - 1]
