"""Evaluating environments that a function makes, and tasks that are not built on `suite.base`."""

import functools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, rollout, suite
from limberjack.evaluation import Evaluation, evaluate
from limberjack.rl.control import Environment
from tests import plain_domain


def _evaluate(make: Callable[..., Any], **kwargs: Any) -> Evaluation:
    return evaluate(make, **{"policy": "random", "seeds": range(3), "num_threads": 1, **kwargs})


def _slower(seed: int) -> Environment:
    environment = plain_domain.make(seed)
    environment._n_sub_steps = seed + 1
    return environment


def test_an_episode_is_the_first_one_of_make_with_its_seed() -> None:
    evaluation = _evaluate(plain_domain.make)
    for score in evaluation.scores["random"]:
        episode = rollout.run_episode(plain_domain.make(score.seed), policies.random, score.seed)
        assert (score.total, score.length) == (episode.total, 25)


def test_a_model_that_depends_on_the_seed_is_made_again_for_each_seed() -> None:
    evaluation = _evaluate(plain_domain.ticking, seeds=range(70))
    for score in evaluation.scores["random"][::23]:
        episode = rollout.run_episode(plain_domain.ticking(score.seed), policies.random, score.seed)
        assert score.total == episode.total


def test_an_environment_of_the_suite_gives_what_its_names_give() -> None:
    def make(seed: int) -> Environment:
        return suite.load("stacker", "stack_2", {"random": seed, "time_limit": 0.1})

    named = evaluate("stacker", "stack_2", "random", range(3), num_threads=1, time_limit=0.1)
    assert _evaluate(make).scores == named.scores


def test_a_result_names_the_function_and_the_hash_of_its_source(tmp_path: Path) -> None:
    evaluation = _evaluate(plain_domain.make, out=tmp_path)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["environment"] == "tests.plain_domain:make"
    assert re.fullmatch("[0-9a-f]{64}", result["environment_sha256"])
    assert not {"domain", "task"} & result.keys()
    assert _evaluate(plain_domain.make, out=tmp_path) == evaluation
    assert (tmp_path / "returns.png").exists()


def test_the_folder_of_another_function_is_refused(tmp_path: Path) -> None:
    _evaluate(plain_domain.make, out=tmp_path)
    with pytest.raises(
        ValueError, match=r"holds an evaluation with environment 'tests\.plain_domain:make'"
    ):
        _evaluate(plain_domain.heavier, out=tmp_path)
    with pytest.raises(ValueError, match="holds an evaluation with domain None"):
        evaluate("humanoid", "stand", "random", range(3), out=tmp_path)


class _Maker:
    def __call__(self, seed: int) -> Environment:
        return plain_domain.make(seed)


@pytest.mark.parametrize(
    "make",
    [lambda seed: plain_domain.make(seed), functools.partial(plain_domain.push, 0.5), _Maker()],
    ids=["a lambda", "a partial", "an object"],
)
def test_a_factory_that_its_source_does_not_identify_is_evaluated_but_not_kept(
    make: Callable[[int], Environment], tmp_path: Path
) -> None:
    assert _evaluate(make).scores == _evaluate(plain_domain.make).scores
    with pytest.raises(ValueError, match="cannot be distinguished from other functions"):
        _evaluate(make, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def _no_seed() -> Environment:
    return plain_domain.make(0)


def _no_environment(seed: int) -> dict[str, int]:
    return {"seed": seed}


@pytest.mark.parametrize(
    ("make", "kwargs", "message"),
    [
        (
            plain_domain.make,
            {"task": "random"},
            "task is 'random', but tests.plain_domain:make makes the",
        ),
        (
            plain_domain.make,
            {"time_limit": 1.0},
            "time_limit is 1.0, but tests.plain_domain:make makes",
        ),
        (plain_domain.endless, {}, "has no time limit, .*: give it a time_limit"),
        (_slower, {}, r"_slower makes an environment that differs for seed 1: its episodes have"),
        (_no_seed, {}, r"cannot be called with a seed; expected make\(seed\) -> Environment"),
        (_no_environment, {}, "made a dict; expected a dm_env.Environment"),
        ("humanoid", {}, "domain is 'humanoid' and task is None; expected the name of a task"),
    ],
)
def test_what_cannot_be_evaluated_is_refused_before_anything_is_played(
    make: Any, kwargs: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        _evaluate(make, out=tmp_path / "out", **kwargs)
    assert not (tmp_path / "out").exists()


def test_a_seed_that_makes_no_difference_is_refused() -> None:
    def unseeded(seed: int) -> Environment:
        return plain_domain.push()

    with pytest.raises(ValueError, match=r"differs each time it is called with seed 0"):
        _evaluate(unseeded)


def test_a_task_that_cannot_be_vectorised_is_played_in_complete_environments() -> None:
    class OneOnly(plain_domain.Push):
        def get_reward(self, physics: Any) -> Any:
            return physics.data.qpos[0]

    def make(seed: int) -> Environment:
        environment = plain_domain.make(seed)
        environment._task = OneOnly(seed)
        return environment

    evaluation = _evaluate(make, seeds=range(3))
    for score in evaluation.scores["random"]:
        episode = rollout.run_episode(make(score.seed), policies.random, score.seed)
        assert score.total == episode.total


def test_a_task_without_starts_has_no_strata_and_rewards_of_any_size() -> None:
    evaluation = _evaluate(plain_domain.make, seeds=range(10))
    assert evaluation.strata() == {}
    returns = [score.total for score in evaluation.scores["random"]]
    assert min(returns) < 0 < max(returns)
    assert evaluation.summary().mean == np.mean(returns)
