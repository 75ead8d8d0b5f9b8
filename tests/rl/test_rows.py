"""Batches of complete environments: each row equals the single environment, whatever its class."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack.rl.rows import RowsEnvironment

from . import odd_environments as odd

_SEED = 3


def _singles(kind: str, actions: np.ndarray) -> list[list[odd.Facts]]:
    """What single environments do: a list a step, of rows."""
    rows = range(actions.shape[1])
    played = [odd.steps_of(odd.KINDS[kind](_SEED + row), actions[:, row]) for row in rows]
    return [list(step) for step in zip(*played, strict=True)]


@pytest.mark.parametrize("kind", odd.KINDS)
@pytest.mark.parametrize(("rows", "threads"), [(1, 1), (2, 1), (5, 2)])
def test_each_row_is_the_single_environment(kind: str, rows: int, threads: int) -> None:
    actions = odd.actions_of(2 * odd.STEPS + 5, rows)
    expected = _singles(kind, actions)
    batch = RowsEnvironment(odd.KINDS[kind], rows, threads, seed=_SEED)
    assert odd.future(batch, actions) == expected
    batch.close()


def _batch(kind: str, rows: int = 3, threads: int = 2, seed: int = _SEED) -> RowsEnvironment:
    return RowsEnvironment(odd.KINDS[kind], rows, threads, seed=seed)


@pytest.mark.parametrize("steps", [0, odd.STEPS + 2])
@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_snapshot_has_the_same_future_in_its_batch_and_in_others(kind: str, steps: int) -> None:
    actions = odd.actions_of(steps + 12, 3)
    batch = _batch(kind)
    odd.future(batch, actions[:steps])
    snapshot = batch.snapshot()
    twin, pickled = copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))
    expected = odd.future(batch, actions[steps:])
    assert odd.future(twin, actions[steps:]) == expected
    assert odd.future(pickled, actions[steps:]) == expected
    batch.restore(snapshot)
    assert odd.future(batch, actions[steps:]) == expected
    other = _batch(kind, threads=1, seed=77)
    odd.future(other, actions[:2])
    other.restore(pickle.loads(pickle.dumps(snapshot)))
    assert odd.future(other, actions[steps:]) == expected
    other.restore(snapshot)  # which none of the futures has changed
    assert odd.future(other, actions[steps:]) == expected


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_copied_row_continues_as_its_source_and_others_as_before(kind: str) -> None:
    actions = odd.actions_of(16, 3)
    actions[:, 2] = actions[:, 0]
    batch, reference = _batch(kind), _batch(kind)
    for one in (batch, reference):
        odd.future(one, actions[:3])
    batch.copy_row(0, 2)
    found, expected = odd.future(batch, actions[3:]), odd.future(reference, actions[3:])
    for step, of_rows in enumerate(expected):
        assert found[step] == [of_rows[0], of_rows[1], of_rows[0]]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_rows_restored_by_themselves_leave_the_others(kind: str) -> None:
    actions = odd.actions_of(16, 3)
    batch, reference = _batch(kind), _batch(kind)
    for one in (batch, reference):
        odd.future(one, actions[:3])
    snapshot = batch.snapshot([0, 2])
    odd.future(batch, actions[3:5])
    batch.restore(snapshot, [0, 1])
    actions[:, 1] = actions[:, 2]
    found, expected = odd.future(batch, actions[3:]), odd.future(reference, actions[3:])
    for step, of_rows in enumerate(expected):
        assert found[step][:2] == [of_rows[0], of_rows[2]]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_rows_that_must_begin_begin_after_a_restored_snapshot_too(kind: str) -> None:
    actions = odd.actions_of(9, 3)
    batch = _batch(kind)
    odd.future(batch, actions[:2])
    batch.restart()
    snapshot = batch.snapshot()
    expected = odd.future(batch, actions[2:])
    assert all(facts[0] == 0 for facts in expected[0])
    batch.restore(snapshot)
    assert odd.future(batch, actions[2:]) == expected
    twin = _batch(kind, seed=9)
    twin.restore(snapshot)
    assert odd.future(twin, actions[2:]) == expected


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_reset_with_seeds_begins_their_first_episodes_and_leaves_other_rows(kind: str) -> None:
    actions = odd.actions_of(20, 4)
    batch = _batch(kind, 4)
    expected = _singles(kind, actions)
    assert odd.future(batch, actions[:5]) == expected[:5]
    for step, seeds in ((5, [9, 4]), (7, [2, 9]), (9, [9, 9])):
        batch.reset([1, 3], seeds=seeds)
        singles = [odd.KINDS[kind](seed) for seed in seeds]
        for env in singles:
            env.reset()
        found = odd.future(batch, actions[step : step + 2])
        for i, row in enumerate((1, 3)):
            alone = list(odd.steps_of(singles[i], actions[step : step + 2, row]))
            assert [of_rows[row] for of_rows in found] == alone
        for i, of_rows in enumerate(found):
            assert of_rows[0] == expected[step + i][0]
            assert of_rows[2] == expected[step + i][2]


@pytest.mark.parametrize("kind", odd.KINDS)
def test_a_partial_reset_without_seeds_is_the_reset_of_a_single_environment(kind: str) -> None:
    actions = odd.actions_of(20, 3)
    batch = _batch(kind)
    singles = [odd.KINDS[kind](_SEED + row) for row in range(3)]
    masks = np.random.RandomState(0).uniform(size=(20, 3)) < 0.2
    for action, mask in zip(actions, masks, strict=True):
        shown = batch.reset(mask) if mask.any() else None
        for row in np.flatnonzero(mask):
            begun = singles[row].reset()
            assert shown is not None
            assert odd.facts(shown, row) == odd.facts(begun)
        found = odd.future(batch, action[None])[0]
        assert found == [next(odd.steps_of(env, action[None, i])) for i, env in enumerate(singles)]


@pytest.mark.parametrize("kind", [one for one in odd.KINDS if one not in odd.FROM_BUILD_ONLY])
def test_copies_of_an_instance_are_rows_of_any_seed(kind: str) -> None:
    actions = odd.actions_of(14, 3)
    env = odd.KINDS[kind](_SEED)
    batch = RowsEnvironment(env, 3, 2, seed=_SEED)
    expected = _singles(kind, actions)
    assert odd.future(batch, actions) == expected
    batch.reset(seeds=[_SEED, _SEED + 1, _SEED + 2])
    singles = [odd.KINDS[kind](_SEED + row) for row in range(3)]
    for one in singles:
        one.reset()
    again = [list(odd.steps_of(one, actions[:, row])) for row, one in enumerate(singles)]
    assert odd.future(batch, actions) == [list(step) for step in zip(*again, strict=True)]
    untouched = list(odd.steps_of(env, actions[:, 0]))  # its own rows have not stepped it
    assert untouched == [of_rows[0] for of_rows in expected]


@pytest.mark.parametrize("kind", odd.FROM_BUILD_ONLY[:2])
def test_an_instance_that_cannot_have_another_seed_is_refused(kind: str) -> None:
    with pytest.raises(TypeError, match=r"build\(seed\)"):
        RowsEnvironment(odd.KINDS[kind](0), 2, 1, seed=0)
