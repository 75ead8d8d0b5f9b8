"""Random streams of rows, model fields that belong to a stream, and staggered first episodes."""

import copy
import itertools
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack import gym, rl, suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale, stream_beside
from limberjack.rl.streams import (
    Stagger,
    Streams,
    check_limit,
    check_not_randomized,
    set_stream_fields,
)
from limberjack.suite import base, lqr

from . import odd_environments as odd

_LARGEST = 2**32 - 1


def test_a_row_draws_from_a_stream_with_its_seed() -> None:
    streams = Streams(seed=7, count=3)
    for row in range(3):
        assert streams.own[row].rand() == np.random.RandomState(7 + row).rand()
        beside = stream_beside(np.random.RandomState(7 + row))
        assert streams.beside[row].rand() == beside.rand()


def test_without_a_seed_rows_differ_from_each_other_and_from_time_to_time() -> None:
    drawn = [stream.rand() for _ in range(2) for stream in Streams(None, 3).own]
    assert len(set(drawn)) == 6


def test_replacing_a_stream_replaces_the_one_for_model_fields() -> None:
    streams = Streams(seed=0, count=2)
    streams.replace(1, np.random.RandomState(40))
    assert streams.own[1].rand() == np.random.RandomState(40).rand()
    assert streams.beside[1].rand() == stream_beside(np.random.RandomState(40)).rand()
    assert streams.own[0].rand() == np.random.RandomState(0).rand()


def test_the_seed_of_a_row_is_known_until_its_stream_is_loaded() -> None:
    streams = Streams(seed=7, count=3)
    streams.replace(1, np.random.RandomState(40), 40)
    assert streams.seeds == [7, 40, 9]
    streams.replace(0, np.random.RandomState(41))
    streams.load(np.array([2]), streams.save(np.array([1]), with_beside=True))
    assert streams.seeds == [None, 40, None]


@pytest.mark.parametrize("with_beside", [True, False])
def test_saved_streams_continue_in_other_rows(with_beside: bool) -> None:
    source = Streams(seed=3, count=4)
    for stream in (*source.own, *source.beside):
        stream.rand(5)
    saved = source.save(np.array([1, 3]), with_beside)
    target = Streams(seed=90, count=4)
    target.load(np.array([2, 0]), saved)
    assert target.own[2].rand() == source.own[1].rand()
    assert target.own[0].rand() == source.own[3].rand()
    if with_beside:
        assert target.beside[2].rand() == source.beside[1].rand()
        assert target.beside[0].rand() == source.beside[3].rand()
    else:
        assert target.beside[0].rand() == Streams(seed=90, count=4).beside[0].rand()


def test_saved_states_do_not_advance_with_the_stream() -> None:
    streams = Streams(seed=3, count=1)
    saved = streams.save(np.array([0]), with_beside=True)
    drawn = streams.own[0].rand(3), streams.beside[0].rand(3)
    streams.load(np.array([0]), saved)
    np.testing.assert_array_equal(drawn, (streams.own[0].rand(3), streams.beside[0].rand(3)))


def test_the_largest_seed_is_accepted_and_the_next_is_refused() -> None:
    assert (
        Streams(seed=_LARGEST - 2, count=3).own[2].rand() == np.random.RandomState(_LARGEST).rand()
    )
    with pytest.raises(ValueError, match=f"expected at most {_LARGEST - 3} for so many rows"):
        Streams(seed=_LARGEST - 2, count=4)


_TASK = ("lqr", "lqr_6_2")  # draws the stiffness of its springs
_LIMIT: dict[str, Any] = {"time_limit": 0.3}  # ten steps


def _single(seed: int) -> Any:
    return suite.load(*_TASK, {"random": seed, **_LIMIT})


def _batch(num_envs: int, seed: int, **kwargs: Any) -> BatchEnvironment:
    return suite.load_batch(*_TASK, num_envs, 2, seed, _LIMIT, **kwargs)


def _springs(env: Any) -> np.ndarray:
    return env.physics.named.model.jnt_stiffness[:].copy()


def _actions(steps: int) -> np.ndarray:
    return np.random.RandomState(0).uniform(-1, 1, (steps, 2))


def _episodes(env: Any, steps: int = 25) -> list[bytes]:
    """Observations of the steps of more than two episodes."""
    told = [env.reset(), *map(env.step, _actions(steps))]
    return [b"".join(value.tobytes() for value in step.observation.values()) for step in told]


def _rows(batch: Any, steps: int = 25) -> list[list[bytes]]:
    """The same of each row of a batch."""
    told = [batch.reset()]
    told += [batch.step(np.stack([action] * batch.num_envs)) for action in _actions(steps)]
    return [
        [b"".join(value[row].tobytes() for value in step.observation.values()) for step in told]
        for row in range(batch.num_envs)
    ]


def test_seeds_have_springs_of_their_own_that_all_their_episodes_share() -> None:
    env = _single(0)
    springs = _springs(env)
    assert len(set(springs)) == 6
    _episodes(env)
    np.testing.assert_array_equal(_springs(env), springs)
    np.testing.assert_array_equal(_springs(_single(0)), springs)
    assert not np.isin(_springs(_single(1)), springs).any()


def test_a_row_is_the_single_environment_with_its_own_springs() -> None:
    batch, singles = _batch(5, 3), [_single(3 + row) for row in range(5)]
    np.testing.assert_array_equal(_springs(batch), [_springs(single) for single in singles])
    assert _rows(batch) == [_episodes(single) for single in singles]
    np.testing.assert_array_equal(_springs(batch), [_springs(single) for single in singles])


@pytest.mark.parametrize("randomize", [None, {"body_mass": scale(0.5, 2)}])
def test_a_reseeded_environment_is_a_new_one(randomize: Any) -> None:
    options = {} if randomize is None else {"randomize": randomize}
    new = suite.load(*_TASK, {"random": 7, **_LIMIT}, options)
    env = suite.load(*_TASK, {"random": 0, **_LIMIT}, options)
    _episodes(env, 13)
    env.reseed(7)
    np.testing.assert_array_equal(_springs(env), _springs(new))
    assert _episodes(env) == _episodes(new)
    batch = _batch(2, 6, environment_kwargs=options)
    new.reseed(7)
    assert _rows(batch)[1] == _episodes(new)
    batch.reset(seeds=[None, 7])
    new.reseed(7)
    new.reset()
    np.testing.assert_array_equal(_springs(batch)[1], _springs(new))
    np.testing.assert_array_equal(batch.physics.data.qpos[1], new.physics.data.qpos)


def test_rows_that_get_new_seeds_get_their_springs_and_others_keep_theirs() -> None:
    batch = _batch(4, 0)
    batch.reset()
    before = _springs(batch)
    batch.reset([1, 3], seeds=[20, None])
    after = _springs(batch)
    np.testing.assert_array_equal(after[1], _springs(_single(20)))
    np.testing.assert_array_equal(after[[0, 2, 3]], before[[0, 2, 3]])
    batch.reset([1])  # continues the stream
    np.testing.assert_array_equal(_springs(batch), after)


def test_gymnasiums_reset_with_a_seed_gives_the_environment_of_that_seed() -> None:
    env, envs = gym.load(*_TASK, **_LIMIT), gym.load_vector(*_TASK, 3, **_LIMIT)
    (batch,) = envs.batches
    for seed in (4, 9):
        expected = _single(seed)
        first = expected.reset().observation
        observation, _ = env.reset(seed=seed)
        observations, _ = envs.reset(seed=seed - 2)
        for name, value in first.items():
            np.testing.assert_array_equal(observation[name], value)
            np.testing.assert_array_equal(observations[name][2], value)
        for found in (_springs(env.environment), _springs(batch)[2]):
            np.testing.assert_array_equal(found, _springs(expected))
    envs.reset(seed=[None, 50, None])
    np.testing.assert_array_equal(_springs(batch)[1], _springs(_single(50)))
    np.testing.assert_array_equal(_springs(batch)[2], _springs(_single(9)))


def test_snapshots_and_rows_carry_the_springs() -> None:
    source, other, batch = _single(3), _single(8), _batch(3, 40)
    source.reset(), batch.reset()
    snapshot = pickle.loads(pickle.dumps(source.snapshot()))
    other.restore(snapshot)
    batch.restore(snapshot, [1])
    batch.copy_row(1, 2)
    for springs in (_springs(other), *_springs(batch)[1:]):
        np.testing.assert_array_equal(springs, _springs(source))
    np.testing.assert_array_equal(_springs(batch)[0], _springs(_single(40)))
    back = _single(0)
    back.restore(batch.snapshot([2]))
    assert _episodes(source) == _episodes(other) == _episodes(back)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_and_pickles_carry_the_springs(duplicate: Any) -> None:
    env, batch = _single(3), _batch(3, 7)
    env.reset(), batch.reset()
    env_twin, batch_twin = duplicate(env), duplicate(batch)
    np.testing.assert_array_equal(_springs(env_twin), _springs(env))
    np.testing.assert_array_equal(_springs(batch_twin), _springs(batch))
    assert _episodes(env_twin) == _episodes(env)
    assert _rows(batch_twin) == _rows(batch)
    batch_twin.reset([0], seeds=[3])
    np.testing.assert_array_equal(_springs(batch_twin)[0], _springs(env))


def test_environments_do_not_share_springs_although_they_share_a_compiled_model() -> None:
    one, other = _single(0), _single(1)
    springs = _springs(other)
    one.reseed(5)
    np.testing.assert_array_equal(_springs(other), springs)


class _Undeclared(lqr.LQRLevel):
    EPISODE_FIELDS = ()


class _Remembering(lqr.LQRLevel):
    """Keeps on the task what belongs to a stream, so that all rows have the last row's."""

    def begin_stream(self, random: np.random.RandomState) -> Any:
        self._scale = random.uniform(1, 2)
        return {}

    def get_observation(self, physics: Any) -> Any:
        return {"position": self._scale * physics.position()}


def _of(task: base.Task) -> control.Environment:
    return control.Environment(_single(0).physics, task, time_limit=1)


def test_a_task_that_does_not_declare_what_it_draws_is_refused() -> None:
    env = _of(_Undeclared(0.1, random=0, drawn_springs=6))
    message = (
        r"begin_stream of task _Undeclared sets jnt_stiffness; declare EPISODE_FIELDS = "
        r"\('jnt_stiffness',\), so that each row has its own"
    )
    with pytest.raises(ValueError, match=message):
        env.reseed(1)
    with pytest.raises(ValueError, match=message):
        BatchEnvironment.from_environment(env, 2)


def test_a_task_that_keeps_a_streams_draws_on_itself_is_refused_in_a_batch() -> None:
    env = _of(_Remembering(0.1, random=0))
    with pytest.raises(ValueError, match=r"_Remembering sets self\._scale in begin_stream"):
        BatchEnvironment.from_environment(env, 2)


def test_what_is_drawn_for_each_seed_cannot_be_randomised_as_well() -> None:
    options = {"randomize": {"jnt_stiffness": scale(0.9, 1.1)}}
    message = "randomize names jnt_stiffness, which task LQRLevel draws itself for each seed"
    with pytest.raises(ValueError, match=message):
        suite.load(*_TASK, {"random": 0}, options)
    check_not_randomized(lqr.LQRLevel(0.1), ["jnt_stiffness"])  # draws nothing


def test_a_model_of_your_own_keeps_its_springs() -> None:
    stream = np.random.RandomState(3)
    physics = lqr.Physics.from_xml_string(*lqr.get_model_and_assets(6, 2, stream))
    env = control.Environment(physics, lqr.LQRLevel(0.1, random=stream), time_limit=0.3)
    np.testing.assert_array_equal(_springs(env), _springs(_single(3)))
    env.reseed(9)
    batch = BatchEnvironment.from_environment(env, 2, seed=0)
    for springs in (_springs(env), *_springs(batch)):
        np.testing.assert_array_equal(springs, _springs(_single(3)))


def test_a_task_without_the_hook_draws_nothing() -> None:
    class Plain:
        pass

    task: Any = Plain()
    stream = np.random.RandomState(0)
    assert not set_stream_fields(task, stream, _single(0).physics.simulation)
    assert stream.rand() == np.random.RandomState(0).rand()


_KINDS = [pytest.param(True, id="vectorised"), pytest.param(False, id="rows")]
_MOST_STEPS = 12
_CARTPOLE = {"time_limit": _MOST_STEPS * 0.01}
_FIRST, _LAST = 0, 2


def _cartpoles(num_envs: int, vectorised: bool | None = True, **kwargs: Any) -> Any:
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
    lengths = np.array(_lengths(_cartpoles(64, seed=0), 3))
    assert set(lengths[:, 0]) == set(range(1, _MOST_STEPS + 1))
    assert (lengths[:, 1:] == _MOST_STEPS).all()


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
    batch = _cartpoles(3, vectorised, seed=0)
    first = _lengths(batch)
    batch.reset()
    assert _lengths(batch) == [[_MOST_STEPS]] * 3
    batch.reset([1], seeds=[1])
    assert _lengths(batch)[1] == first[1]
    batch.reset()
    assert _lengths(batch) == [[_MOST_STEPS]] * 3
    batch.reset(seeds=[2, None, 0])
    assert _lengths(batch) == [first[2], [_MOST_STEPS], first[0]]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_no_draw_of_the_task_or_of_randomisation_changes(vectorised: bool) -> None:
    kwargs: dict[str, Any] = {
        "seed": 5,
        "environment_kwargs": {"randomize": {"body_mass": scale(0.5, 2.0)}},
    }
    starts = []
    for stagger in (True, False):
        batch = _cartpoles(3, vectorised, stagger=stagger, **kwargs)
        found: list[list[Any]] = [[], [], []]
        for _ in range(3 * _MOST_STEPS):
            time_step = batch.step(np.zeros((3, 1)))
            for row in np.flatnonzero(time_step.step_type == _FIRST):
                observation = [v[row].tolist() for v in time_step.observation.values()]
                found[row].append((observation, batch.randomization["body_mass"][row].tolist()))
        starts.append([one[:2] for one in found])
        batch.close()
    assert starts[0] == starts[1]


def _future(batch: Any, steps: int = 2 * _MOST_STEPS) -> list[Any]:
    actions = np.random.RandomState(0).uniform(-1, 1, (steps, batch.num_envs, 1))
    return [[*facts, batch.timed_out.tolist()] for facts in _each(batch, actions)]


def _each(batch: Any, actions: np.ndarray) -> Any:
    for action in actions:
        time_step = batch.step(action)
        yield [odd.facts(time_step, row) for row in range(batch.num_envs)]


@pytest.mark.parametrize("steps", [0, 1, 4])
@pytest.mark.parametrize("vectorised", _KINDS)
def test_snapshots_pickles_and_copies_carry_the_lengths(vectorised: bool, steps: int) -> None:
    batch = _cartpoles(3, vectorised, seed=1)
    _future(batch, steps)
    snapshot = batch.snapshot()
    copies = copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))
    other_kind = _cartpoles(3, not vectorised, seed=8)
    other_kind.restore(pickle.loads(pickle.dumps(snapshot)))
    expected = _future(batch)
    batch.restore(snapshot)
    for one in (*copies, batch, other_kind):
        assert _future(one) == expected


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_copied_row_ends_with_its_source(vectorised: bool) -> None:
    batch = _cartpoles(4, vectorised, seed=0)
    for steps in (0, 1):
        _future(batch, steps)
        batch.copy_row(2, 0)
        twin = copy.deepcopy(batch)
        lengths = _lengths(twin, 2)
        assert lengths[0] == lengths[2]


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_restored_episode_ends_at_the_limit_here_if_that_is_earlier(vectorised: bool) -> None:
    batch = _cartpoles(2, vectorised, seed=0, task_kwargs={"time_limit": 0.4})
    _lengths(batch)
    batch.reset()
    short = _cartpoles(2, vectorised, seed=0)
    short.restore(batch.snapshot())
    assert _lengths(short) == [[_MOST_STEPS]] * 2


@pytest.mark.parametrize("vectorised", _KINDS)
def test_an_episode_is_restored_where_the_present_one_is_shorter(vectorised: bool) -> None:
    full = _cartpoles(2, vectorised, seed=0)
    full.reset()
    full.reset()  # the first episodes only are shorter
    _future(full, _MOST_STEPS - 1)
    short = _cartpoles(2, vectorised, seed=0)
    assert all(first < _MOST_STEPS for first, *_ in _lengths(copy.deepcopy(short)))
    short.reset()  # which sets the limits
    short.restore(full.snapshot())
    assert _future(short) == _future(full)


@pytest.mark.parametrize("vectorised", _KINDS)
def test_a_limit_of_one_step_leaves_nothing_to_draw(vectorised: bool) -> None:
    batch = _cartpoles(2, vectorised, task_kwargs={"time_limit": 0.01})
    assert _lengths(batch, 3) == [[1, 1, 1]] * 2


@pytest.mark.parametrize("vectorised", _KINDS)
def test_no_limit_is_refused_at_once_and_later(vectorised: bool) -> None:
    with pytest.raises(ValueError, match="stagger is True, but the episodes have no time limit"):
        rl.batch_of(suite.load("lqr", "lqr_2_1"), 2, vectorised=vectorised, stagger=True)
    batch = _cartpoles(2, vectorised, seed=0)
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
        _cartpoles(2, vectorised, stagger=stagger)


@pytest.mark.parametrize("vectorised", _KINDS)
def test_lengths_are_control_steps_where_actions_are_repeated(vectorised: bool) -> None:
    plain = _lengths(_cartpoles(8, vectorised, seed=0), 2)
    repeated = _lengths(_cartpoles(8, vectorised, seed=0, action_repeat=5), 2)
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
    made.append(gymnasium.make_vec(name, 8, max_episode_steps=_MOST_STEPS, **how))
    made.append(gymnasium.make_vec(name, 8, max_episode_steps=_MOST_STEPS, pipelined=True, **how))
    expected = [one[0] for one in _lengths(_cartpoles(8, seed=0))]
    for envs in made:
        envs.reset(seed=0)
        lengths = np.zeros(8, int)
        for step in range(1, _MOST_STEPS + 1):
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


@pytest.mark.parametrize("vectorised", [True, False])
def test_after_a_snapshot_without_a_share_a_row_plays_whole_episodes(vectorised: bool) -> None:
    env = suite.load("pendulum", "swingup", {"random": 0, "time_limit": 0.4})
    env.reset()
    env.step([0.0])
    how: dict[str, Any] = {"stagger": True, "vectorised": vectorised}
    batch = rl.batch_of(env, 2, 1, seed=5, **how)
    batch.restore(env.snapshot(), [0])
    ends = [
        step
        for step in range(1, 60)  # of 20 steps; another one begins the next episode
        if batch.step(np.zeros((2, 1))).step_type[0] == _LAST
    ]
    assert ends == [19, 40]
