"""Traces: rewards, observations and actions of an episode, step by step."""

from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.episodes import Episode
from limberjack.see import report
from limberjack.see.report import Step
from limberjack.see.report import trace as trace_module
from limberjack.see.report.labels import Labels
from tests.representatives import PAIRS
from tests.rollouts import run_episode


def _traced(domain: str, task: str, seconds: float) -> tuple[Episode, report.Trace]:
    """An episode of random actions, and what was traced of it."""
    env = suite.load(domain, task, {"random": 3, "time_limit": seconds})
    trace = report.Trace(env)
    return run_episode(env, policies.random, 3, trace.add), trace


@pytest.mark.parametrize(("domain", "task"), PAIRS)
def test_a_trace_is_of_every_step(domain: str, task: str) -> None:
    episode, trace = _traced(domain, task, 0.25)
    count = episode.length + 1
    np.testing.assert_array_equal(trace.rewards[1:], episode.rewards)
    assert np.isnan(trace.rewards[0])
    env = suite.load(domain, task, {"random": 3, "time_limit": 0.25})
    np.testing.assert_array_equal(trace.seconds, np.arange(count) * env.control_timestep())
    observation = env.reset().observation
    assert list(trace.observations) == list(observation)
    for name, value in observation.items():
        assert trace.observations[name].shape == (count, np.size(value))
        np.testing.assert_array_equal(trace.observations[name][0], np.ravel(value))
    step = env.step(policies.random(env.action_spec(), 3)(observation))
    assert step.reward == trace.rewards[1]
    assert {name: series[1] for name, series in trace.terms.items()} == env.task.reward_terms(
        env.physics
    )


def test_actions_are_traced_as_the_policy_gave_them() -> None:
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.25})
    trace = report.Trace(env)
    given = []
    run_episode(env, policies.random, 3, lambda step: (given.append(step.action), trace.add(step)))
    assert trace.actions.shape == (len(given), 21)
    assert np.isnan(trace.actions[0]).all()
    np.testing.assert_array_equal(trace.actions[1:], np.array(given[1:]))
    before = trace.actions[1:].copy()
    given[1][...] = 7.0  # the trace has copies
    np.testing.assert_array_equal(trace.actions[1:], before)


def test_actions_that_are_no_arrays_are_not_traced() -> None:
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.05})
    trace = report.Trace(env)
    time_step = env.reset()
    trace.add(Step(0, 0.0, time_step, None))
    nested: Any = {"arm": np.zeros(3), "leg": np.zeros(2)}
    trace.add(Step(1, 0.0, env.step(np.zeros(21)), nested))
    assert trace.actions.shape == (2, 0)


def test_a_term_that_the_last_step_lacks_is_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    env = suite.load("cartpole", "swingup", {"random": 3, "time_limit": 0.03})
    trace = report.Trace(env)
    early = iter([{"upright": 1.0, "early": 0.5}, {"upright": 1.0}, {"upright": 1.0}])
    monkeypatch.setattr(trace_module, "shown_by", lambda *arguments: next(early))
    run_episode(env, policies.random, 3, trace.add)
    np.testing.assert_array_equal(trace.terms["early"], [np.nan, 0.5, np.nan, np.nan])


def test_a_picture_is_not_traced_but_named_with_its_size() -> None:
    env = suite.load("cartpole", "swingup", {"random": 3, "time_limit": 0.05})
    observe = env.task.get_observation
    env.task.get_observation = lambda physics: {
        **observe(physics),
        "pixels": np.zeros((84, 84, 3), np.uint8),
    }
    trace = report.Trace(env)
    run_episode(env, policies.random, 3, trace.add)
    assert list(trace.observations) == ["position", "velocity"]
    assert trace.too_large == {"pixels": 84 * 84 * 3}


def test_labels_are_known_when_the_episode_has_ended() -> None:
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.05})
    trace = report.Trace(env)
    assert trace.labels == Labels({}, ())
    run_episode(env, policies.zero, 3, trace.add)
    assert {name: len(labels) for name, labels in trace.labels.observations.items()} == {
        name: values.shape[1] for name, values in trace.observations.items()
    }
    assert len(trace.labels.actions) == trace.actions.shape[1]


def test_a_long_trace_is_kept_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trace_module, "_MOST_SAMPLES", 8)
    episode, trace = _traced("humanoid", "walk", 0.5)  # 20 steps
    np.testing.assert_allclose(trace.seconds, 0.025 * np.arange(0, 21, 4))
    np.testing.assert_array_equal(trace.rewards[1:], episode.rewards[3::4])
    assert all(len(series) == 6 for series in trace.observations.values())
    assert trace.actions.shape == (6, 21)


def test_plans_are_traced_at_the_steps_that_they_are_for() -> None:
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.1})
    trace = report.Trace(env)
    trace.add(Step(0, 0.0, env.reset(), None))
    plans = [("reach", {"far": 3.0}), ("reach", {"far": 2.0}), ("grasp", {"open": 1.0})]
    for number, plan in enumerate(plans, 1):
        trace.add_plan(*plan)
        trace.add(Step(number, 0.0, env.step(np.zeros(21)), np.zeros(21)))
    nan = np.nan
    np.testing.assert_array_equal(trace.plan_terms["far"], [nan, 3.0, 2.0, nan])
    np.testing.assert_array_equal(trace.plan_terms["open"], [nan, nan, nan, 1.0])
    assert trace.stages == [(0.0, "reach"), (0.05, "grasp")]


def test_the_plans_of_a_long_trace_are_those_of_its_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trace_module, "_MOST_SAMPLES", 2)
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.1})
    trace = report.Trace(env)
    trace.add(Step(0, 0.0, env.reset(), None))
    for number in range(1, 5):
        trace.add_plan("reach", {"far": float(number)})
        trace.add(Step(number, 0.0, env.step(np.zeros(21)), np.zeros(21)))
    np.testing.assert_allclose(trace.seconds, [0.0, 0.1])
    np.testing.assert_array_equal(trace.plan_terms["far"], [np.nan, 4.0])


def test_a_trace_without_a_planner_has_no_plans() -> None:
    _, trace = _traced("humanoid", "walk", 0.1)
    assert trace.plan_terms == {}
    assert trace.stages == []


def test_a_task_without_terms_is_traced_by_its_reward() -> None:
    env = suite.load("humanoid", "walk", {"random": 0, "time_limit": 0.05})
    env.task.get_reward = lambda physics: 0.25  # pyright: ignore[reportAttributeAccessIssue]
    trace = report.Trace(env)
    run_episode(env, policies.zero, 0, trace.add)
    assert trace.rewards[1:].tolist() == [0.25, 0.25]
    assert trace.terms == {}


def test_a_task_that_draws_for_its_observation_draws_no_more_when_traced() -> None:
    def run(*, traced: bool) -> list[list[float]]:
        env = suite.load("stacker", "stack_2", {"random": 3, "time_limit": 0.05})
        task, observe = env.task, env.task.get_observation
        task.get_observation = lambda physics: {
            "noise": task.random.standard_normal(2),
            **observe(physics),
        }
        seen: list[list[float]] = []
        trace = report.Trace(env)

        def add(step: Step) -> None:
            seen.append(step.time_step.observation["noise"].tolist())
            if traced:
                trace.add(step)

        run_episode(env, policies.zero, 3, add)
        assert not traced or trace.observations["noise"].tolist() == seen
        return seen

    assert run(traced=True) == run(traced=False)
