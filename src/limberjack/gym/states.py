"""The option `state` of a reset: the state in which episodes begin, for one simulation or rows.

    env.reset(options={"state": {"qpos": qpos, "qvel": qvel}})          # (nq,), (nv,)
    envs.reset(options={"state": {"qpos": qpos}})                       # (num_envs, nq)
    envs.reset(options={"state": [snapshot, None, {"qvel": qvel}]})     # one for each row

The start is drawn as usual; then the state is set. Both functions check it completely and change
nothing.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from limberjack.gym.single import Single
from limberjack.rl.batch_contract import Batch
from limberjack.rl.control import Environment
from limberjack.rl.given_state import (
    check_snapshot,
    checked_state,
    checked_states,
    state_sizes,
)
from limberjack.rl.many import ManyTasks
from limberjack.rl.snapshot import Snapshot

__all__ = ["State", "States", "state_of_one", "states_of_rows"]

State = dict[str, np.ndarray] | Snapshot
# Row numbers, (n,), and the state of these rows: the arguments of calls of `Batch.set_states`.
States = list[tuple[np.ndarray, State]]


def state_of_one(given: object, environment: Environment | Single) -> State | None:
    """The state for the environment's `set_state`; None if none is given.

    Raises:
      TypeError, ValueError: it is not a state of this environment; see `rl.given_state`.
    """
    if given is None:
        return None
    own = environment.snapshot() if isinstance(given, Snapshot) else None
    is_copy = own is not None and bool(own.copies)  # of a class that may have no such state
    sizes = {} if is_copy else _sizes(environment)
    if not isinstance(given, Snapshot) or own is None:
        return checked_state(given, sizes)
    check_snapshot(given, own, 1, sizes, environment._step_limit)
    return given


def _sizes(environment: Environment | Single) -> dict[str, int]:
    if isinstance(environment, Single):
        return environment.state_sizes()
    return state_sizes(environment.physics)


def states_of_rows(
    given: object, batches: Sequence[Batch], begun: Sequence[np.ndarray]
) -> list[States]:
    """The states for the rows of each batch that begin an episode; those of others are ignored.

    Args:
      given: a mapping of arrays, (num_envs, size) each; a snapshot of num_envs environments; or a
        list that has a mapping, a snapshot of one environment, or None for each row. None for none.
      batches: the batch, or the halves.
      begun: for each batch, the mask of rows that begin an episode.

    Raises:
      TypeError, ValueError: a state does not fit; messages number the rows of all batches.
    """
    if given is None:
        return [[] for _ in batches]
    if any(isinstance(batch, ManyTasks) for batch in batches) and not isinstance(
        given, list | tuple
    ):
        if not isinstance(given, Snapshot):
            raise TypeError(
                f"state is a {type(given).__name__}, but the rows are of several tasks, whose "
                "states differ; expected a list with a state or None for each row, or a snapshot "
                "of all rows; nothing was reset"
            )
        given = [given.part(row) for row in range(len(given))]
    if isinstance(given, list | tuple):
        return _of_a_list(given, batches, begun)
    rows = np.flatnonzero(np.concatenate(begun))
    if isinstance(given, Snapshot):
        return _of_a_snapshot(given, batches, rows)
    num_envs = sum(batch.num_envs for batch in batches)
    arrays = checked_states(given, batches[0].state_sizes(), num_envs, rows)
    return [
        [(of_batch, {name: values[here] for name, values in arrays.items()})]
        for of_batch, here in _split(batches, rows)
    ]


def _of_a_snapshot(snapshot: Snapshot, batches: Sequence[Batch], rows: np.ndarray) -> list[States]:
    num_envs = sum(batch.num_envs for batch in batches)
    first = batches[0]
    own = first.snapshot([0])
    snapshot.check_all(own, num_envs)
    # Pictures that are ignored may have any form.
    used = {name: value for name, value in snapshot.frames.items() if name in own.frames}
    snapshot = dataclasses.replace(snapshot, frames=used)
    taken = snapshot.part(rows)
    sizes = {} if own.copies else first.state_sizes()  # copies may be of classes without a state
    check_snapshot(taken, own, len(rows), sizes, first.step_limit, rows)
    return [[(of_batch, taken.part(here))] for of_batch, here in _split(batches, rows)]


def _of_a_list(
    given: Sequence[object], batches: Sequence[Batch], begun: Sequence[np.ndarray]
) -> list[States]:
    num_envs = sum(batch.num_envs for batch in batches)
    if len(given) != num_envs:
        raise ValueError(
            f"there are {len(given)} states; expected {num_envs}: one for each row, or None; "
            "nothing was reset"
        )
    return [
        _of_items(given[start : start + batch.num_envs], batch, start, mask)
        for batch, start, mask in zip(batches, _starts(batches), begun, strict=True)
    ]


def _of_items(items: Sequence[object], batch: Batch, start: int, begun: np.ndarray) -> States:
    """The states of one batch, those of a task with the same fields together."""
    if isinstance(batch, ManyTasks):
        return [
            (numbers + rows.start, state)
            for part, rows in zip(batch.parts, batch.rows_of, strict=True)
            for numbers, state in _of_items(items[rows], part, start + rows.start, begun[rows])
        ]
    given = [item for item, is_begun in zip(items, begun, strict=True) if is_begun]
    own = batch.snapshot([0]) if any(isinstance(item, Snapshot) for item in given) else None
    has_mappings = not all(item is None or isinstance(item, Snapshot) for item in given)
    needs_sizes = has_mappings or (own is not None and not own.copies)
    sizes = batch.state_sizes() if needs_sizes else {}
    found: States = []
    together: dict[tuple[str, ...], list[tuple[int, dict[str, np.ndarray]]]] = {}
    for row in np.flatnonzero(begun).tolist():
        item, what = items[row], f"state of row {row + start}"
        if item is None:
            continue
        if isinstance(item, Snapshot) and own is not None:
            try:
                check_snapshot(item, own, 1, sizes, batch.step_limit)
            except ValueError as error:
                raise ValueError(f"the {what}: {error}") from error
            found.append((np.array([row]), item))
            continue
        checked = checked_state(item, sizes, what)
        together.setdefault(tuple(sorted(checked)), []).append((row, checked))
    for names, of_rows in together.items():
        rows = np.array([row for row, _ in of_rows])
        found.append((rows, {name: np.stack([one[name] for _, one in of_rows]) for name in names}))
    return found


def _starts(batches: Sequence[Batch]) -> list[int]:
    """The number of each batch's first row among the rows of all."""
    sizes = [batch.num_envs for batch in batches]
    return [sum(sizes[:i]) for i in range(len(sizes))]


def _split(batches: Sequence[Batch], rows: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each batch, its rows among the given ones: their numbers in it, and their positions."""
    split = []
    for batch, start in zip(batches, _starts(batches), strict=True):
        here = np.flatnonzero((rows >= start) & (rows < start + batch.num_envs))
        split.append((rows[here] - start, here))
    return split
