"""Two halves stepped in turn: the same numbers, on threads that never harm anybody."""

import logging
import pickle
import threading
import time
from typing import Any

import numpy as np
import pytest
from gymnasium import error
from gymnasium.vector import AutoresetMode

from limberjack import gym
from limberjack.gym.halves import Workers, joined
from limberjack.rl import control
from tests.programs import run

from .gym_episodes import MODES, assert_same, falling_envs


def _pair(**kwargs: Any) -> tuple[gym.VectorEnv, gym.VectorEnv]:
    """The same rows in one batch and in two halves, begun."""
    pair = falling_envs(5, flat=True, **kwargs), falling_envs(3, 2, flat=True, **kwargs)
    for envs in pair:
        envs.reset(seed=0)
    return pair


def _actions(envs: gym.VectorEnv, step: int) -> np.ndarray:
    return np.sin(step + np.arange(envs.num_envs)[:, None] + np.arange(21))


def _pipelined(envs: gym.VectorEnv, steps: int) -> list[list[Any]]:
    """The results of both halves, in the plain order."""
    returned: list[list[Any]] = [[] for _ in range(steps)]
    for half, rows in enumerate(envs.halves):
        envs.send(_actions(envs, 0)[rows], half)
    for step in range(steps):
        for half, rows in enumerate(envs.halves):
            result = envs.recv()
            assert result[4].pop("env_id").tolist() == list(range(5))[rows]
            returned[step].append(result)
            if step + 1 < steps:
                envs.send(_actions(envs, step + 1)[rows], half)
    return returned


@pytest.mark.parametrize("copied", [True, False])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_halves_sent_in_turn_give_the_numbers_of_the_plain_order(
    mode: AutoresetMode, copied: bool
) -> None:
    plain, halves = _pair(autoreset_mode=mode)
    for step, parts in enumerate(_pipelined(halves, 40)):
        observation, reward, terminated, truncated, info = plain.step(_actions(plain, step))
        for rows, part in zip(halves.halves, parts, strict=True):
            assert_same(part[:4], (observation[rows], reward[rows], terminated[rows],
                                   truncated[rows]))  # fmt: skip
            for name, term in part[4]["reward_terms"].items():
                assert_same(term, info["reward_terms"][name][rows])
            if "final_obs" in part[4]:
                assert_same(list(part[4]["final_obs"]), list(info["final_obs"][rows]))
    halves.close()


@pytest.mark.parametrize("mode", MODES)
def test_a_plain_step_of_halves_is_that_of_one_batch(mode: AutoresetMode) -> None:
    plain, halves = _pair(autoreset_mode=mode)
    for step in range(40):
        one, other = (envs.step(_actions(envs, step)) for envs in (plain, halves))
        for name in {*one[4], *other[4]} & {"final_obs"}:
            assert_same(list(one[4].pop(name)), list(other[4].pop(name)))
        assert_same(one, other)
        ended = one[2] | one[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended}
            assert_same(plain.reset(options=options), halves.reset(options=options))


def test_a_mask_of_one_half_leaves_the_other_alone() -> None:
    plain, halves = _pair()
    mask = np.array([False, False, False, True, True])
    for seed in (None, 7):
        options = {"reset_mask": mask}
        one = plain.reset(seed=seed, options=options)
        assert_same(one, halves.reset(seed=seed, options=options))


def test_an_odd_number_of_rows_has_the_larger_half_first() -> None:
    envs = gym.load_vector("humanoid", "walk", 5, num_threads=1, pipelined=True)
    assert envs.halves == (slice(0, 3), slice(3, 5))
    assert [batch.num_envs for batch in envs.batches] == [3, 2]


def test_the_caller_continues_while_a_half_is_stepped() -> None:
    _, envs = _pair()
    part, entered, leave = envs._parts[0], threading.Event(), threading.Event()
    step = part.step

    def slow_step(actions: Any) -> Any:
        entered.set()
        assert leave.wait(60)
        return step(actions)

    part.step = slow_step  # pyright: ignore[reportAttributeAccessIssue]
    envs.send(np.zeros((3, 21)), 0)
    assert entered.wait(60)
    envs.send(np.zeros((2, 21)), 1)  # returns although half 0 is under way
    leave.set()
    assert [envs.recv()[4]["env_id"].size for _ in range(2)] == [3, 2]
    envs.close()


def test_the_actions_are_copied_when_they_are_sent() -> None:
    plain, halves = _pair()
    actions = np.ones((5, 21))
    expected = plain.step(actions)
    given = actions[:3].copy()
    halves.send(given, 0)
    given[...] = np.nan
    assert_same(halves.recv()[1], expected[1][:3])
    halves.close()


# Refused input.


def test_errors_of_a_half_number_rows_within_the_whole_batch() -> None:
    _, halves = _pair()
    second = halves.batches[1]
    with pytest.raises(ValueError, match=r"not finite in rows \[4\]"):
        second.step([np.zeros(21), np.full(21, np.nan)])
    second.physics.data.qvel[0] = 1e12
    second._raises = True
    halves.send(np.zeros((2, 21)), 1)
    with pytest.raises(control.PhysicsError, match=r"rows \[3\] diverged"):
        halves.recv()
    halves.close()


def test_a_restored_or_given_state_and_the_log_number_rows_within_the_whole_batch(
    caplog: pytest.LogCaptureFixture,
) -> None:
    _, halves = _pair()
    second = halves.batches[1]
    snapshot = second.snapshot()
    snapshot.physics["state"][1, 3] = np.nan
    with caplog.at_level(logging.WARNING, "limberjack"):
        second.restore(snapshot)
        second.step(np.zeros((2, 21)))
    assert "rows [4] diverged" in caplog.text
    with pytest.raises(RuntimeError, match=r"just begun in rows \[3, 4\]: call reset"):
        second.set_states({"qvel": np.zeros((2, 27))})
    halves.reset()
    with pytest.raises(ValueError, match=r"'qvel' of the state is invalid in rows \[3, 4\]"):
        second.set_states({"qvel": np.full((2, 27), np.nan)})
    states = {"qvel": np.zeros((5, 27))}
    states["qvel"][3] = np.inf
    with pytest.raises(ValueError, match=r"'qvel' of the state is invalid in rows \[3\]"):
        halves.reset(options={"state": states})
    second._raises = True
    second.restore(snapshot)
    with pytest.raises(control.PhysicsError, match=r"rows \[4\] diverged"):
        second.step(np.zeros((2, 21)))
    halves.close()


def test_bad_actions_are_refused_when_they_are_sent_and_nothing_is_stepped() -> None:
    plain, halves = _pair()
    bad = np.zeros((3, 21))
    bad[1] = np.nan
    refused = (
        (bad, 0, r"not finite in rows \[1\]"),
        (bad[:2], 1, r"not finite in rows \[4\]"),  # of the whole batch
        (np.zeros((5, 21)), 0, "expected 3 rows"),
        (np.zeros((3, 20)), 0, r"shape \(3, 20\); expected \(3, 21\)"),
    )
    for actions, half, message in refused:
        with pytest.raises(ValueError, match=message):
            halves.send(actions, half)
    whole = np.zeros((5, 21))
    whole[4] = np.inf
    with pytest.raises(ValueError, match=r"not finite in rows \[4\]"):
        halves.step(whole)  # the first half must not have moved
    with pytest.raises(ValueError, match=r"shape \(4, 21\); expected \(5, 21\)"):
        halves.step(np.zeros((4, 21)))
    assert_same(plain.step(np.ones((5, 21)))[:4], halves.step(np.ones((5, 21)))[:4])


def test_use_out_of_turn_is_refused() -> None:
    plain, envs = _pair()
    with pytest.raises(RuntimeError, match="nothing was sent"):
        envs.recv()
    with pytest.raises(ValueError, match="half is 2; expected 0 or 1"):
        envs.send(np.zeros((3, 21)), 2)
    with pytest.raises(RuntimeError, match="pipelined=True"):
        plain.send(np.zeros((5, 21)), 0)
    envs.send(np.zeros((3, 21)), 0)
    uses = (envs.reset, envs.render, lambda: envs.step(np.zeros((5, 21))))
    for use in (*uses, lambda: envs.send(np.zeros((3, 21)), 0), lambda: pickle.dumps(envs)):
        with pytest.raises(RuntimeError, match=r"sent.*recv\(\)"):
            use()
    envs.recv()
    envs.reset(seed=0)
    envs.close()


def test_sending_before_the_first_reset_is_refused() -> None:
    with pytest.raises(error.ResetNeeded):
        falling_envs(2, 2).send(np.zeros((2, 21)), 0)


def test_divergence_is_raised_where_it_is_received() -> None:
    envs = gym.load_vector(
        "humanoid", "walk", 4, num_threads=1, pipelined=True, on_divergence="raise"
    )
    envs.reset(seed=0)
    envs.batches[1].physics.data.qpos[0, 2] = np.nan
    for half in (0, 1):
        envs.send(np.zeros((2, 21)), half)
    envs.recv()
    with pytest.raises(control.PhysicsError, match=r"rows \[2\]"):
        envs.recv()
    with pytest.raises(RuntimeError, match="nothing was sent"):
        envs.recv()
    envs.reset()
    envs.close()


def test_a_plain_step_names_the_rows_of_both_halves_and_leaves_neither_behind() -> None:
    envs = gym.load_vector("humanoid", "walk", 4, pipelined=True, on_divergence="raise")
    envs.reset(seed=0)
    actions = np.zeros((4, 21))
    actions[3, 0] = np.nan
    with pytest.raises(ValueError, match=r"rows \[3\]"):
        envs.step(actions)
    envs.batches[1].physics.data.qpos[0, 2] = np.nan
    with pytest.raises(control.PhysicsError, match=r"rows \[2\]"):
        envs.step(np.zeros((4, 21)))
    assert all(batch.begins.all() for batch in envs.batches)
    envs.close()


# Threads.


def _threads_of_halves() -> int:
    return sum(thread.name.startswith("limberjack-half") for thread in threading.enumerate())


def test_closing_waits_for_running_steps_and_ends_the_threads() -> None:
    _, envs = _pair()
    for half, rows in enumerate(envs.halves):
        envs.send(np.zeros((5, 21))[rows], half)
    assert _threads_of_halves() == 2
    envs.close()
    assert _threads_of_halves() == 0


def test_the_threads_of_an_environment_that_is_dropped_end() -> None:
    _, envs = _pair()
    envs.send(np.zeros((3, 21)), 0)
    envs.recv()
    del envs
    for _ in range(600):
        if not _threads_of_halves():
            break
        time.sleep(0.1)
    assert _threads_of_halves() == 0


_BEGIN = """
    import os
    import signal
    import sys
    import threading
    import time
    import numpy as np
    from limberjack import gym

    envs = gym.load_vector("stacker", "stack_4", 64, num_threads=2, pipelined=True)
    envs.reset(seed=0)

    def send_both():
        for half in (0, 1):
            envs.send(np.ones((32, 5)), half)
    """


def test_exit_in_the_middle_of_a_step_is_silent() -> None:
    for end in ("", "sys.exit()"):
        assert run(f"{_BEGIN}\n    send_both()\n    {end}\n") == ""


def test_an_interrupt_while_receiving_loses_nothing() -> None:
    program = f"""{_BEGIN}
    def interrupt():
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGINT)

    step = envs._parts[0].step
    def slow_step(actions):
        time.sleep(2)
        return step(actions)
    envs._parts[0].step = slow_step
    send_both()
    threading.Thread(target=interrupt).start()
    try:
        envs.recv()
    except KeyboardInterrupt:
        print("interrupted")
    first, second = (envs.recv() for _ in range(2))
    twin = gym.load_vector("stacker", "stack_4", 64, num_threads=2)
    twin.reset(seed=0)
    reward = twin.step(np.ones((64, 5)))[1]
    assert np.array_equal(reward, np.concatenate([first[1], second[1]]))
    envs.close()
    print("whole")
    """
    assert run(program) == "interrupted\nwhole\n"


def test_a_forked_child_has_threads_of_its_own() -> None:
    program = f"""{_BEGIN}
    send_both()
    envs.recv(), envs.recv()
    sys.stdout.flush()
    child = os.fork()
    send_both()
    total = sum(float(envs.recv()[1].sum()) for _ in range(2))
    envs.close()
    if child == 0:
        print(total, flush=True)
        sys.exit()
    assert os.waitpid(child, 0)[1] == 0
    print(total)
    """
    # Newer Pythons warn of any fork of a process with threads.
    one, other = run(program, warnings="ignore").split()
    assert one == other


def test_parts_are_joined_by_name_and_a_missing_one_counts_as_zeros() -> None:
    first, second = np.array([1.0, 2.0]), np.array([[3, 4]], np.uint8)
    both = joined([{"a": first}, {"a": np.array([5.0]), "b": second}], [2, 1])
    assert both["a"].tolist() == [1.0, 2.0, 5.0]
    assert both["b"].tolist() == [[0, 0], [0, 0], [3, 4]]
    assert both["b"].dtype == np.uint8
    assert joined([None, {"b": second}], [2, 1])["b"].shape == (3, 2)


def test_a_missing_part_of_objects_counts_as_none() -> None:
    given = np.array([{"x": 1}], object)
    assert joined([None, given], [2, 1]).tolist() == [None, None, {"x": 1}]


def test_the_half_that_was_sent_first_is_received_first() -> None:
    workers = Workers(2)
    go_on = threading.Event()

    def first() -> str:
        go_on.wait(60)
        return "first"

    workers.send(1, first)
    workers.send(0, lambda: "second")
    assert workers.busy == [1, 0]
    go_on.set()
    assert [workers.receive(), workers.receive()] == [(1, "first"), (0, "second")]
    with pytest.raises(RuntimeError, match="nothing was sent"):
        workers.receive()
    workers.close()
