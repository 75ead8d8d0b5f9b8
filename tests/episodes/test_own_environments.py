"""Environments of a user's own, of any class, through the whole journey."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import data, suite
from limberjack.data import Kept
from limberjack.episodes.films import record
from limberjack.evaluation import evaluate
from limberjack.rl import control
from limberjack.rl.copies import control_of
from limberjack.training import Settings
from limberjack.training.run import _identified
from limberjack.workers.factories import factory_of
from tests.rl import odd_environments as odd


def remembering(seed: int) -> Any:
    """A task with undeclared memory."""
    return odd.of_task(odd.LastAction, seed)


def noisy(seed: int) -> Any:
    """A task that draws in the hooks of a step."""
    return odd.of_task(odd.Noisy, seed)


def delaying(seed: int) -> Any:
    """A subclass whose step is its own."""
    return odd.of_class(odd.Delaying, seed)


class OwnNames(odd.Delaying):
    """A subclass with attributes of its own under names that dm_control leaves free."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        vars(self).update(world="kitchen", step_limit=None)


def named(seed: int) -> Any:
    """A subclass that uses names of ours for something else."""
    return odd.of_class(OwnNames, seed)


def pictured(seed: int) -> Any:
    """Stacked pictures."""
    pixels = {"camera": -1, "height": 8, "width": 8, "frame_stack": 2}
    return odd.environment(odd.LastAction, seed, pixels=pixels)


_MAKES = [remembering, noisy, delaying, odd.nested, odd.scaled, odd.distracting, odd.randomized]
_MAKES += [odd.shifting, odd.flat, odd.measuring, named, odd.joined]


def _rewards(make: Any, seed: int, actions: np.ndarray, repeat: int = 1) -> list[float]:
    env, rewards = make(seed), []
    time_step = env.reset()
    for action in actions[::repeat]:
        for _ in range(repeat):
            if not time_step.last():
                time_step = env.step(action)
                rewards.append(time_step.reward)
    return rewards


@pytest.mark.parametrize("make", _MAKES, ids=lambda make: make.__name__)
def test_episodes_of_any_environment_are_kept_and_replayed(make: Any, tmp_path: Path) -> None:
    data.collect(make, None, "random", range(3), out=tmp_path, num_threads=1, kept=Kept(True))
    dataset = data.load(tmp_path)
    for episode in dataset:
        assert episode.rewards.tolist() == _rewards(make, episode.seed, episode.actions)
        assert episode.observations
        assert episode.states is not None
        assert len(episode.states) == episode.length + 1
    assert data.replay(dataset, make, num_threads=1) is None
    scores = evaluate(make, None, "random", range(3), num_threads=1).scores["random"]
    assert [score.total for score in scores] == [episode.total for episode in dataset]


class _Late(odd.Pole):
    """Draws from NumPy's global stream, late."""

    def get_reward(self, physics: Any) -> Any:
        return np.random.uniform() if physics.data.time > 0.4 else 1.0


def late(seed: int) -> Any:
    """An environment that does not depend on its seed alone."""
    return odd.environment(_Late, seed, time_limit=0.5)


def test_a_late_draw_from_a_global_stream_is_refused() -> None:
    with pytest.raises(ValueError, match="a step draws from NumPy's global stream"):
        evaluate(late, policy="zero", seeds=range(3))


def heavy_from_5(seed: int) -> Any:
    """A model that depends on the seed, though not on the first ones."""
    env = odd.environment(odd.Pole, seed)
    if seed >= 5:
        env.physics.model.body_mass[-1] *= 2
    return env


@pytest.mark.parametrize("seeds", [[6], range(8)], ids=["one", "several"])
def test_each_seed_is_played_in_what_the_function_makes_for_it(seeds: Any, tmp_path: Path) -> None:
    actions = np.zeros((odd.STEPS, 1))
    found = evaluate(heavy_from_5, policy="zero", seeds=seeds).scores["zero"]
    for score in found:
        assert score.total == pytest.approx(sum(_rewards(heavy_from_5, score.seed, actions)), abs=0)
    data.collect(heavy_from_5, None, "zero", seeds, out=tmp_path)
    assert data.replay(data.load(tmp_path), heavy_from_5) is None


def test_names_that_a_subclass_uses_for_itself_are_not_read(tmp_path: Path) -> None:
    data.collect(named, None, "random", range(3), out=tmp_path, num_threads=1)
    assert data.load(tmp_path).policy_card("cloning", named(0)).world is None
    facts = _identified(factory_of(named), Settings(), 0, None)
    assert facts["world"] is None


def test_workers_collect_the_same_bytes(tmp_path: Path) -> None:
    for folder, workers in (("here", None), ("there", 2)):
        out = tmp_path / folder
        data.collect(remembering, None, "random", range(62, 67), out=out, workers=workers)
    files = [
        {path.name: path.read_bytes() for path in (tmp_path / folder / "episodes").iterdir()}
        for folder in ("here", "there")
    ]
    assert files[0] == files[1]


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("repeat", [2, 3])
def test_repeated_actions_and_their_pictures_are_kept_and_replayed(
    repeat: int, tmp_path: Path
) -> None:
    data.collect(
        pictured, None, "random", range(2), out=tmp_path, num_threads=1, action_repeat=repeat
    )
    dataset = data.load(tmp_path)
    for episode in dataset:
        expected = _rewards(pictured, episode.seed, episode.actions, repeat)
        assert episode.rewards.tolist() == expected
        assert episode.observations["pixels"].dtype == np.uint8
    assert data.replay(dataset, pictured, num_threads=1) is None


def test_a_dataset_names_its_function_and_runs_nothing_by_that_name(tmp_path: Path) -> None:
    data.collect(remembering, None, "zero", [0], out=tmp_path, num_threads=1)
    dataset = data.load(tmp_path)
    facts = dataset.recipe.facts
    assert facts["environment"] == f"{__name__}:remembering"
    assert len(str(facts["environment_sha256"])) == 64
    with pytest.raises(ValueError, match=r"environments that .*:remembering makes: give that func"):
        data.replay(dataset)
    with pytest.raises(ValueError, match="noisy is not the function that made the episodes' envir"):
        data.replay(dataset, noisy)


def test_a_dataset_of_a_domain_whose_source_has_changed_does_not_grow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, out = tmp_path / "growing_domain.py", tmp_path / "out"
    module.write_text("from tests.plain_domain import SUITE\n")
    monkeypatch.syspath_prepend(tmp_path)
    suite.register("growing", "growing_domain")
    try:
        for count in (1, 2):
            data.collect("growing", "push", "zero", range(count), out=out, num_threads=1)
        dataset = data.load(out)
        assert (len(dataset), data.replay(dataset, num_threads=1)) == (2, None)
        module.write_text("from tests.plain_domain import SUITE  # otherwise\n")
        with pytest.raises(ValueError, match="domain_sha256 is '"):
            data.collect("growing", "push", "zero", range(3), out=out, num_threads=1)
    finally:
        suite.unregister("growing")
    with pytest.raises(ValueError, match="of 'growing', which is no domain of the suite: import"):
        data.replay(dataset)


def test_what_cannot_be_named_is_not_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="cannot be distinguished from other functions"):
        data.collect(lambda seed: remembering(seed), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("pictures")
def test_an_episode_of_a_users_environment_is_filmed(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    view: Any = {"height": 32, "width": 32, "camera": -1}
    record(delaying, out=tmp_path / "policy.gif", policy="random", rows=2, **view)
    for kept in (Kept(), Kept(states=True)):
        out = tmp_path / f"{kept.states}"
        data.collect(delaying, None, "random", [3], out=out, num_threads=1, kept=kept)
        data.film(data.load(out), 3, delaying, out=tmp_path / f"{kept.states}.gif", **view)
    assert (tmp_path / "True.gif").read_bytes() == (tmp_path / "False.gif").read_bytes()
    inner = control_of(delaying(3))
    assert isinstance(inner, control.Environment)
