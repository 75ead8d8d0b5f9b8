"""Bad input is refused with a clear error and does not affect the environment."""

import re
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import mujoco as lj_mujoco
from limberjack import suite
from limberjack.rl import control
from tests.laws.episodes import DOMAINS, Task, actions, bits, load, play, snapshot
from tests.representatives import REPRESENTATIVES, USUAL

_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION.value


def bad_actions(n: int) -> dict[str, tuple[Any, type[Exception], str]]:
    """Actions that an environment with `n` actuators refuses, the error type and its message."""
    some = np.linspace(-1, 1, n)
    expected = rf"expected \({n},\)"
    with_nan, with_inf = some.copy(), some.copy()
    with_nan[2], with_inf[[0, 2]] = np.nan, [np.inf, -np.inf]
    return {
        "too few": (some[1:], ValueError, rf"\({n - 1},\); {expected}"),
        "too many": (np.append(some, 0), ValueError, rf"\({n + 1},\); {expected}"),
        "a scalar": (0.5, ValueError, rf"action has shape \(\); {expected}"),
        "(1,)": (np.zeros(1), ValueError, rf"\(1,\); {expected}"),
        "(1, n)": (some[None], ValueError, rf"\(1, {n}\); {expected}"),
        "(n, 1)": (some[:, None], ValueError, rf"\({n}, 1\); {expected}"),
        "nothing": (None, TypeError, "dtype object; expected numbers: None"),
        "a string": ("forward", TypeError, "expected numbers: 'forward'"),
        "a mapping": ({"torque": some}, TypeError, "expected numbers"),
        "strings": (["0.5"] * n, TypeError, "expected numbers"),
        "Nones": ([None] * n, TypeError, "dtype object; expected numbers"),
        "objects": ([object()] * n, TypeError, "dtype object; expected numbers"),
        "complex numbers": (some * 1j, TypeError, "dtype complex128; expected numbers"),
        "dates": (np.zeros(n, "M8[s]"), TypeError, "expected numbers"),
        "NaN": (with_nan, ValueError, r"action is not finite at index \[2\]"),
        "infinity": (list(with_inf), ValueError, r"action is not finite at index \[0, 2\]"),
        "single precision": (with_nan.astype("f4"), ValueError, "action is not finite"),
    }


def refused(call: Callable[[], Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match) as caught:
        call()
    assert caught.type is error


@pytest.mark.parametrize("task", USUAL)
def test_a_bad_action_is_refused_and_nothing_has_moved(task: Task) -> None:
    env, twin = load(task), load(task)
    for name, (action, error, match) in bad_actions(env.physics.model.nu).items():
        play(env, 2)
        assert play(twin, 2), name
        before = snapshot(env)
        refused(lambda given=action: env.step(given), error, match)
        assert snapshot(env) == before, name
        assert play(env, 3, reset=False) == play(twin, 3, reset=False), name


def test_a_ragged_action_is_refused_by_name() -> None:
    env, twin = load(("stacker", "stack_2")), load(("stacker", "stack_2"))
    play(env, 2), play(twin, 2)
    refused(
        lambda: env.step([[0.1, 0.2], [0.3]]),
        ValueError,
        "action is .*; expected an array of numbers",
    )
    assert play(env, 3, reset=False) == play(twin, 3, reset=False)


@pytest.mark.parametrize(
    "huge",
    [np.float64(1e154), np.finfo(np.float32).max, np.finfo(np.float16).max],
    ids=["double", "single", "half"],
)
def test_huge_finite_actions_are_accepted_without_a_warning(huge: Any) -> None:
    env, twin = load(("humanoid", "stand")), load(("humanoid", "stand"))
    env.reset(), twin.reset()
    action = np.full(21, huge, huge.dtype)
    # MuJoCo clips controls to their range.
    assert bits(env.step(action).observation) == bits(twin.step(np.ones(21)).observation)


def test_the_largest_number_is_an_action() -> None:
    env = load(("humanoid", "stand"))
    env.reset()
    with np.errstate(over="ignore"):  # the cost of control is its square, as in dm_control
        step = env.step(np.full(21, -np.finfo(float).max))
    assert step.mid()
    assert 0 <= step.reward <= 1


@pytest.mark.parametrize(
    "action", [[1] * 21, np.ones(21, bool), np.ones(21, np.uint8), (1.0,) * 21]
)
def test_any_numbers_are_an_action(action: Any) -> None:
    env, twin = load(("humanoid", "walk")), load(("humanoid", "walk"))
    env.reset(), twin.reset()
    assert bits(env.step(action)) == bits(twin.step(np.ones(21)))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("humaniod", "walk"), ["'humaniod'", "'humanoid'?", "acrobot, ball_in_cup, cartpole"]),
        (("humanoid", "wlak"), ["'wlak'", "'walk'?", "run, run_pure_state, stand, walk"]),
        (("stacker", "walk"), ["'walk'", "'stacker'", "stack_2, stack_4"]),
        (("Stacker", "stack_2"), ["'Stacker'", "'stacker'?"]),
        ((None, "walk"), ["None", "acrobot, ball_in_cup, cartpole"]),
    ],
)
def test_an_unknown_domain_or_task_brings_choices_and_a_suggestion(
    names: Any, words: list[str]
) -> None:
    for make in (suite.load, suite.build_environment):
        with pytest.raises(ValueError, match=re.escape(words[0])) as caught:
            make(*names)
        for word in words:
            assert word in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (({"radnom": 1},), ["humanoid:walk", "'radnom'", "'random'?", "time_limit"]),
        (({"fully_observable": False},), ["humanoid:walk", "'fully_observable'"]),
        ((None, {"flat_obs": True}), ["humanoid:walk", "'flat_obs'", "'flat_observation'?"]),
        (
            ({"environment_kwargs": {"flat_obs": True}},),
            ["humanoid:walk", "'flat_obs'", "'flat_observation'?"],
        ),
    ],
)
def test_an_unknown_keyword_is_named_with_those_there_are(arguments: Any, words: Any) -> None:
    with pytest.raises(TypeError) as caught:
        suite.load("humanoid", "walk", *arguments)
    for word in words:
        assert word in str(caught.value)


def test_the_mappings_of_keywords_are_left_as_they_were() -> None:
    task_kwargs, environment_kwargs = {"random": 1}, {"flat_observation": True}
    suite.load("humanoid", "walk", task_kwargs, environment_kwargs)
    assert (task_kwargs, environment_kwargs) == ({"random": 1}, {"flat_observation": True})


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_the_time_limit_must_be_a_positive_number(task: Task) -> None:
    for value in (float("nan"), 0, -1.0, float("-inf")):
        refused(
            lambda v=value: suite.load(*task, {"time_limit": v}),
            ValueError,
            f"time_limit is {value}; expected a positive number",
        )


@pytest.mark.parametrize("value", [0, -1, 2.0, 1.5, float("nan"), "2"])
def test_the_number_of_sub_steps_must_be_a_whole_positive_number(value: Any) -> None:
    physics, task = load(("humanoid", "walk")).physics, load(("humanoid", "walk")).task
    match = re.escape(f"n_sub_steps is {value!r}; expected a whole number of at least 1")
    refused(lambda: control.Environment(physics, task, n_sub_steps=value), ValueError, match)


@pytest.mark.parametrize(
    ("value", "match"),
    [
        (0.0051, "must be an integer multiple of physics timestep"),
        (float("inf"), "must be an integer multiple of physics timestep"),
        (0.001, "cannot be smaller than physics timestep"),
        (0, "cannot be smaller than physics timestep"),
        (-0.005, "cannot be smaller than physics timestep"),
        (float("nan"), "cannot be smaller than physics timestep"),
    ],
)
def test_the_control_step_must_be_a_multiple_of_the_physics_step(value: Any, match: str) -> None:
    env = load(("humanoid", "walk"))
    match = rf"Control timestep \({value}\) {match} \(0.005\)"
    refused(
        lambda: control.Environment(env.physics, env.task, control_timestep=value),
        ValueError,
        match,
    )


@pytest.mark.parametrize("task", USUAL)
def test_the_control_step_is_given_once(task: Task) -> None:
    match = r"n_sub_steps \(3\) and control_timestep \(0\.\d+\) were supplied"
    refused(lambda: load(task, n_sub_steps=3), ValueError, match)


@pytest.mark.parametrize("name", ["time_limit", "control_timestep"])
def test_values_that_are_not_numbers_are_refused_by_name(name: str) -> None:
    env = load(("humanoid", "walk"))
    keywords: dict[str, Any] = {name: "ten"}
    with pytest.raises((TypeError, ValueError), match=name):
        control.Environment(env.physics, env.task, **keywords)


@pytest.mark.parametrize("task", DOMAINS)
def test_a_state_of_the_wrong_size_changes_nothing(task: Task) -> None:
    env, twin = load(task), load(task)
    play(env, 3), play(twin, 3)
    physics, before = env.physics, snapshot(env)
    for sig in (None, _INTEGRATION, mujoco.mjtState.mjSTATE_QPOS.value):
        size = physics.get_state(sig).size
        for state in (np.zeros(size - 1), np.zeros(size + 1), np.zeros((1, size)), 0.0, []):
            match = re.escape(f"shape {np.shape(state)}. Expected ({size},)")
            refused(lambda s=state, g=sig: physics.set_state(s, g), ValueError, match)
        with pytest.raises((TypeError, ValueError)):
            physics.set_state(["x"] * size, sig)
    assert snapshot(env) == before
    assert play(env, 3, reset=False) == play(twin, 3, reset=False)


def test_malformed_xml_keeps_mujocos_message_and_the_physics_its_model() -> None:
    env, twin = load(("humanoid", "walk")), load(("humanoid", "walk"))
    play(env, 3), play(twin, 3)
    cut = "<mujoco><worldbody>"
    wrong = "<mujoco><worldbody><geom type='cube' size='1'/></worldbody></mujoco>"
    for xml, message in ((cut, "XML parse error"), (wrong, "invalid keyword: 'cube'")):
        refused(lambda x=xml: lj_mujoco.Physics.from_xml_string(x), ValueError, message)
        refused(lambda x=xml: env.physics.reload_from_xml_string(x), ValueError, message)
    refused(lambda: lj_mujoco.Physics.from_xml_path("/no/such.xml"), ValueError, "/no/such.xml")
    assert play(env, 3, reset=False) == play(twin, 3, reset=False)


@pytest.mark.parametrize(
    ("read", "error", "words"),
    [
        (lambda named: named.data.xpos["hed"], KeyError, ["body", "'hed'", "'head'?", "torso"]),
        (lambda named: named.data.xpos["head", "w"], KeyError, ["column", "'w'", "x, y, z"]),
        (lambda named: named.data.qpos[["abdomen_x", "knee"]], KeyError, ["'knee'", "right_knee"]),
        (lambda named: named.data.xpoz, AttributeError, ["MjData", "'xpoz'", "'xpos'?"]),
        (lambda named: named.model.bodypos, AttributeError, ["'bodypos'", "'body_pos'?"]),
        (lambda named: named.data.time, AttributeError, ["MjData.time is not an array"]),
        (lambda named: named.data.xpos[...], IndexError, ["Ellipsis"]),
        (lambda named: named.data.xpos[None], IndexError, ["None"]),
        (lambda named: named.data.xpos["head", "x", 0], IndexError, ["3 elements", "xpos"]),
        (lambda named: named.data.xpos[""], IndexError, ["Empty"]),
    ],
)
def test_an_unknown_name_is_refused_with_those_there_are(read: Any, error: Any, words: Any) -> None:
    env, twin = load(("humanoid", "walk")), load(("humanoid", "walk"))
    play(env, 3), play(twin, 3)
    with pytest.raises(error) as caught:
        read(env.physics.named)
    for word in words:
        assert word in str(caught.value)
    assert env.physics.named.data.xpos["head"].shape == (3,)
    with pytest.raises(error):  # also after a name that is there was looked up
        read(env.physics.named)
    assert play(env, 3, reset=False) == play(twin, 3, reset=False)


def test_assigning_to_an_unknown_name_changes_nothing() -> None:
    env = load(("humanoid", "walk"))
    env.reset()
    before = snapshot(env)
    with pytest.raises(KeyError, match="'hed'"):
        env.physics.named.data.xpos["hed"] = 1.0
    with pytest.raises(KeyError, match="'knee'"):
        env.physics.named.data.qpos[["right_knee", "knee"]] = 1.0
    with pytest.raises(ValueError, match="broadcast"):
        env.physics.named.data.qpos[["right_knee", "left_knee"]] = [1.0, 2.0, 3.0]
    assert snapshot(env) == before


@pytest.mark.parametrize("task", USUAL)
def test_a_nan_control_raises_and_the_next_step_begins_an_episode(task: Task) -> None:
    env = load(task)
    play(env, 3)
    action = actions(env, 1)[0]

    # Through the physics the controls of a task may still be anything.
    env.task.before_step = lambda action, physics: physics.set_control(np.nan)
    with pytest.raises(control.PhysicsError, match="mjWARN_BADCTRL"):
        env.step(action)
    del env.task.before_step
    env.task._random = np.random.RandomState(9)
    again = [bits(env.step(action)), *play(env, 5, reset=False)]
    assert again == play(load(task, seed=9), 5)


@pytest.mark.parametrize("task", DOMAINS)
def test_a_diverged_state_raises_and_the_next_step_begins_an_episode(task: Task) -> None:
    for field, value in (("qpos", np.nan), ("qvel", 1e12), ("qvel", np.inf)):
        env = load(task)
        play(env, 3)
        getattr(env.physics.data, field)[:] = value
        with pytest.raises(control.PhysicsError, match="mjWARN_BADQ"):
            env.step(actions(env, 1)[0])
        env.reseed(9)
        again = [bits(env.step(actions(env, 1)[0])), *play(env, 5, reset=False)]
        assert again == play(load(task, seed=9), 5)


def test_every_divergence_in_a_row_is_raised() -> None:
    physics = load(("humanoid", "walk")).physics
    for _ in range(3):
        # MuJoCo resets the state itself, and its counts of warnings with it.
        physics.data.qvel[:] = np.nan
        with pytest.raises(control.PhysicsError):
            physics.step()


@pytest.mark.parametrize("kind", [RuntimeError, control.PhysicsError, KeyboardInterrupt])
@pytest.mark.parametrize("hook", ["after_step", "get_reward", "get_observation"])
def test_an_error_in_the_task_ends_the_episode(hook: str, kind: type[BaseException]) -> None:
    env = load(("stacker", "stack_2"))
    play(env, 3)

    def fail(physics: Any) -> None:
        raise kind("in the task")

    setattr(env.task, hook, fail)
    with pytest.raises(kind, match="in the task"):
        env.step(np.zeros(5))
    delattr(env.task, hook)
    env.task._random = np.random.RandomState(9)
    assert bits(env.step(np.zeros(5))) == bits(load(("stacker", "stack_2"), seed=9).reset())


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_closing_twice_is_fine_and_later_use_raises(task: Task) -> None:
    env = load(task)
    play(env, 2)
    physics = env.physics
    env.close()
    env.close()
    physics.free()
    uses: list[Callable[[], Any]] = [
        env.reset,
        lambda: env.step(np.zeros(5)),
        env.action_spec,
        env.observation_spec,
        env.control_timestep,
        physics.step,
        physics.reset,
        physics.copy,
        physics.get_state,
        physics.render,
        lambda: physics.named,
        lambda: physics.model,
        lambda: physics.data,
    ]
    for use in uses:
        with pytest.raises(RuntimeError, match="closed"):
            use()
    with load(task) as other:  # dm_env's context manager closes
        other.reset()
    with pytest.raises(RuntimeError, match="closed"):
        other.reset()
