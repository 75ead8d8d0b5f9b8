"""First episodes that end at different times: their lengths, and all that they leave alone."""

import copy
import itertools
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack import gym, rl, suite
from limberjack.rl import control
from limberjack.rl.randomize import scale, stream_beside
from limberjack.rl.stagger import Stagger, check_limit

from . import odd_environments as odd

_KINDS = [pytest.param(True, id="vectorised"), pytest.param(False, id="rows")]
_LIMIT = 12
_CARTPOLE = {"time_limit": _LIMIT * 0.01}
_FIRST, _LAST = 0, 2


def _batch(num_envs: int, vectorised: bool | None = True, **kwargs: Any) -> Any:
    how: dict[str, Any] = {"num_threads": 1, "task_kwargs": _CARTPOLE, "stagger": True, **kwargs}
    how["vectorised"] = vectorised
    return suite.load_batch("cartpole", "swingup", num_envs, **how)


def _lengths(batch: Any, episodes: int = 1) -> list[list[int]]:
    """The lengths, in calls of `step`, of the next episodes of each row."""
    found: list[list[int]] = [[] for _ in range(batch.num_envs)]
    counts = np.zeros(batch.num_envs, int)
    actions = np.zeros(batch.action_spec().shape)
    while any(len(one) < episodes for one in found):
        time_step = batch.step(actions)
        counts = np.where(time_step.step_type == _FIRST, 0, counts + 1)
        for row in np.flatnonzero(time_step.step_type == _LAST):
            found[row].append(int(counts[row]))
            assert batch.timed_out[row]
            assert time_step.discount[row] == 1.0
    return [one[:episodes] for one in found]


def test_a_length_is_uniform_from_one_step_to_the_limit() -> None:
    stagger = Stagger(3000)
    for row in range(3000):
        stagger.draw(row, np.random.RandomState(row))
    lengths = np.array([stagger.limit_of_next(row, 9.5) for row in range(3000)])
    counts = np.bincount(lengths.astype(int), minlength=11)
    assert counts[0] == 0
    assert counts.sum() == counts[1:11].sum()
    expected = 300
    chi_squared = float(((counts[1:11] - expected) ** 2 / expected).sum())
    assert chi_squared < 27.9  # the 99.9 % quantile with 9 degrees of freedom
    assert all(stagger.limit_of_next(row, 9.5) == 9.5 for row in range(3))


def test_lengths_are_drawn_apart_from_the_fields_that_are_randomized() -> None:
    stagger = Stagger(1)
    stagger.draw(0, np.random.RandomState(4))
    assert stagger.shares[0] != stream_beside(np.random.RandomState(4)).uniform()


def test_a_draw_does_not_advance_the_stream() -> None:
    stream, other = np.random.RandomState(4), np.random.RandomState(4)
    Stagger(1).draw(0, stream)
    assert stream.uniform() == other.uniform()


def test_episodes_without_a_limit_are_refused() -> None:
    check_limit(1.0)
    with pytest.raises(ValueError, match="no time limit: give the task a time_limit"):
        check_limit(float("inf"))


def test_the_first_episodes_end_apart_and_later_ones_are_full() -> None:
    lengths = np.array(_lengths(_batch(64, seed=0), 3))
    assert set(lengths[:, 0]) == set(range(1, _LIMIT + 1))
    assert (lengths[:, 1:] == _LIMIT).all()


@pytest.mark.parametrize("task", ["cartpole", "lqr"])
def test_both_kinds_of_batch_draw_the_same_lengths_for_any_number_of_rows(task: str) -> None:
    names = {"cartpole": ("cartpole", "swingup"), "lqr": ("lqr", "lqr_2_1")}[task]
    found = {}
    for vectorised, rows, threads in itertools.product((True, False), (2, 5), (1, 2)):
        how: dict[str, Any] = {"seed": 3, "task_kwargs": {"time_limit": 0.24}, "stagger": True}
        how["vectorised"] = vectorised
        batch = suite.load_batch(*names, rows, threads, **how)
        found[vectorised, rows, threads] = _lengths(batch)
        batch.close()
    longest = found[True, 5, 1]
    assert len({one[0] for one in longest}) > 1
    for (_, rows, _), lengths in found.items():
        assert lengths == longest[:rows]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_seeded_reset_shortens_an_episode_again_and_others_do_not(vectorised: bool) -> None:
    batch = _batch(3, vectorised, seed=0)
    first = _lengths(batch)
    batch.reset()
    assert _lengths(batch) == [[_LIMIT]] * 3
    batch.reset([1], seeds=[1])
    assert _lengths(batch)[1] == first[1]
    batch.reset()
    assert _lengths(batch) == [[_LIMIT]] * 3
    batch.reset(seeds=[2, None, 0])
    assert _lengths(batch) == [first[2], [_LIMIT], first[0]]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_no_draw_of_the_task_or_of_randomisation_changes(vectorised: bool) -> None:
    kwargs: dict[str, Any] = {
        "seed": 5,
        "environment_kwargs": {"randomize": {"body_mass": scale(0.5, 2.0)}},
    }
    starts = []
    for stagger in (True, False):
        batch = _batch(3, vectorised, stagger=stagger, **kwargs)
        found: list[list[Any]] = [[], [], []]
        for _ in range(3 * _LIMIT):
            time_step = batch.step(np.zeros((3, 1)))
            for row in np.flatnonzero(time_step.step_type == _FIRST):
                observation = [v[row].tolist() for v in time_step.observation.values()]
                found[row].append((observation, batch.randomization["body_mass"][row].tolist()))
        starts.append([one[:2] for one in found])
        batch.close()
    assert starts[0] == starts[1]


def _future(batch: Any, steps: int = 2 * _LIMIT) -> list[Any]:
    actions = np.random.RandomState(0).uniform(-1, 1, (steps, batch.num_envs, 1))
    return [[*facts, batch.timed_out.tolist()] for facts in _each(batch, actions)]


def _each(batch: Any, actions: np.ndarray) -> Any:
    for action in actions:
        time_step = batch.step(action)
        yield [odd.facts(time_step, row) for row in range(batch.num_envs)]


@pytest.mark.parametrize("steps", [0, 1, 4])
@pytest.mark.parametrize("vectorised", _KINDS)
def test_snapshots_pickles_and_copies_carry_the_lengths(vectorised: bool, steps: int) -> None:
    batch = _batch(3, vectorised, seed=1)
    _future(batch, steps)
    snapshot = batch.snapshot()
    copies = copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))
    other_kind = _batch(3, not vectorised, seed=8)
    other_kind.restore(pickle.loads(pickle.dumps(snapshot)))
    expected = _future(batch)
    batch.restore(snapshot)
    for one in (*copies, batch, other_kind):
        assert _future(one) == expected


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_copied_row_ends_with_its_source(vectorised: bool) -> None:
    batch = _batch(4, vectorised, seed=0)
    for steps in (0, 1):
        _future(batch, steps)
        batch.copy_row(2, 0)
        twin = copy.deepcopy(batch)
        lengths = _lengths(twin, 2)
        assert lengths[0] == lengths[2]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_restored_episode_ends_at_the_limit_here_if_that_is_earlier(vectorised: bool) -> None:
    batch = _batch(2, vectorised, seed=0, task_kwargs={"time_limit": 0.4})
    _lengths(batch)
    batch.reset()
    short = _batch(2, vectorised, seed=0)
    short.restore(batch.snapshot())
    assert _lengths(short) == [[_LIMIT]] * 2


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_limit_of_one_step_leaves_nothing_to_draw(vectorised: bool) -> None:
    batch = _batch(2, vectorised, task_kwargs={"time_limit": 0.01})
    assert _lengths(batch, 3) == [[1, 1, 1]] * 2


@pytest.mark.parametrize("vectorised", _KINDS)
def test_no_limit_is_refused_at_once_and_later(vectorised: bool) -> None:
    with pytest.raises(ValueError, match="stagger is True, but the episodes have no time limit"):
        rl.batch_of(suite.load("lqr", "lqr_2_1"), 2, vectorised=vectorised, stagger=True)
    batch = _batch(2, vectorised, seed=0)
    before = _lengths(copy.deepcopy(batch), 2)
    with pytest.raises(ValueError, match="stagger is True, but the episodes have no time limit"):
        batch.step_limit = float("inf")
    assert _lengths(batch, 2) == before
    batch.step_limit = 3
    batch.reset()
    assert _lengths(batch, 2) == [[3, 3]] * 2


@pytest.mark.parametrize("stagger", [1, "yes", None, 0.5])
@pytest.mark.parametrize("vectorised", _KINDS)
def test_anything_but_true_and_false_is_refused(vectorised: bool, stagger: Any) -> None:
    with pytest.raises(ValueError, match=f"stagger is {stagger!r}; expected True or False"):
        _batch(2, vectorised, stagger=stagger)


@pytest.mark.parametrize("vectorised", _KINDS)
def test_lengths_are_control_steps_where_actions_are_repeated(vectorised: bool) -> None:
    plain = _lengths(_batch(8, vectorised, seed=0), 2)
    repeated = _lengths(_batch(8, vectorised, seed=0, action_repeat=5), 2)
    assert repeated == [[-(-length // 5) for length in row] for row in plain]


@pytest.mark.parametrize("kind", ["a counter", "delayed observations", "a walk on a line"])
def test_rows_of_any_class_begin_a_full_episode_after_a_short_one(kind: str) -> None:
    if kind == "a walk on a line":  # counts its steps by itself, without a limit to be seen
        with pytest.raises(ValueError, match="no time limit"):
            rl.batch_of(odd.KINDS[kind], 3, 1, seed=0, stagger=True)
        return
    short = rl.batch_of(odd.KINDS[kind], 6, 1, seed=0, vectorised=False, stagger=True)
    plain = rl.batch_of(odd.KINDS[kind], 6, 1, seed=0, vectorised=False)
    of_short, of_plain = (odd.future(one, np.zeros((7, 6, 1))) for one in (short, plain))
    assert of_short != of_plain
    for row in range(6):
        ended = False
        for step in range(7):
            if ended:
                assert of_short[step][row][0] == _FIRST
                break
            here, there = of_short[step][row], of_plain[step][row]
            ended = here[0] == _LAST
            assert here[1:] == there[1:] or there[0] == _LAST  # but for the step type


def test_vector_environments_of_any_making_are_staggered() -> None:
    made: list[Any] = [
        gym.load_vector("cartpole", "swingup", 8, num_threads=1, stagger=True, time_limit=0.12)
    ]
    gymnasium = pytest.importorskip("gymnasium")
    name = "limberjack/cartpole-swingup-v0"
    how: dict[str, Any] = {"stagger": True, "num_threads": 1}
    made.append(gymnasium.make_vec(name, 8, max_episode_steps=_LIMIT, **how))
    made.append(gymnasium.make_vec(name, 8, max_episode_steps=_LIMIT, pipelined=True, **how))
    expected = [one[0] for one in _lengths(_batch(8, seed=0))]
    for envs in made:
        envs.reset(seed=0)
        lengths = np.zeros(8, int)
        for step in range(1, _LIMIT + 1):
            _, _, terminated, truncated, _ = envs.step(np.zeros((8, 1), np.float32))
            assert not terminated.any()
            lengths = np.where((lengths == 0) & truncated, step, lengths)
        assert lengths.tolist() == expected
        envs.close()
    with pytest.raises(ValueError, match="no time limit"):
        gymnasium.make_vec(name, 2, max_episode_steps=-1, **how)


def test_unseeded_halves_do_not_end_together() -> None:
    envs = gym.load_vector("cartpole", "swingup", 32, num_threads=1, stagger=True, pipelined=True)
    shares = [batch._stagger.shares.tolist() for batch in envs.batches]
    assert set(shares[0]).isdisjoint(shares[1])
    envs.close()


def test_single_environments_have_no_such_option() -> None:
    with pytest.raises(TypeError, match="stagger"):
        control.Environment(None, None, stagger=True)  # pyright: ignore[reportArgumentType, reportCallIssue]
