"""`Batch` and `Windows`: steps of several episodes as arrays, and the order in which they come.

    rows = Rows(episodes, Reading(float32=True, discount=0.99, n_step=3))
    batch = rows.take(np.array([5, 17]))            # two transitions
    windows = WindowsOf(rows, Form(length=16, stride=8))
    windows.take(np.arange(len(windows)))           # all windows of the episodes
    yield from stream([rows, more], size=256, random=np.random.default_rng(0), buffer=10_000)

The arrays of some episodes are joined once, and each batch is gathered from them with one array of
indices. Nothing here reads files; `dataset.Dataset` does, and has the methods that users call.
"""

import collections
import dataclasses
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from limberjack.episodes.episode import Episode, Kept

__all__ = [
    "Batch",
    "Form",
    "Reading",
    "Recent",
    "Rows",
    "Source",
    "Windows",
    "WindowsOf",
    "joined",
    "stream",
    "taken",
]


@dataclasses.dataclass(frozen=True)
class Batch:
    """N transitions, in arrays that may be changed.

    With `n_step` of n (`Dataset.select`), a transition is n steps long, or as many as the episode
    still has: `rewards` are discounted sums, and `next_observations`, `terminated` and `truncated`
    are those after the last of its steps. So the target of a value is
    `rewards + discounts * value(next_observations)` for each n.

    Attributes:
      observations: before the step, by name, (N, ...).
      actions: (N, ...) float64, or float32 after `select(float32=True)`.
      rewards: (N,), of the same type.
      next_observations: after the step, by name, (N, ...).
      terminated: whether the task ended the episode, (N,): nothing follows to bootstrap from.
      truncated: whether the time limit ended the episode, (N,).
      discounts: of the value of `next_observations`, (N,): the discount to the power of the number
        of steps, and 0 where the task ended the episode. None without `discount`.
      returns_to_go: the discounted rewards from the step to the episode's end, (N,), likewise.
    """

    observations: Mapping[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    next_observations: Mapping[str, np.ndarray]
    terminated: np.ndarray
    truncated: np.ndarray
    discounts: np.ndarray | None = None
    returns_to_go: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.rewards)


@dataclasses.dataclass(frozen=True)
class Windows:
    """N windows of L steps that follow each other in one episode, in arrays that may be changed.

    Steps before the episode's first one and after its last one are padding: `mask` is false, the
    observations and actions are those of the nearest step, and everything else is 0 or false.

    Attributes:
      observations: before each step and after the last one, by name, (N, L + 1, ...).
      actions: (N, L, ...) float64, or float32 after `select(float32=True)`.
      rewards: (N, L), of the same type.
      terminated: whether the task ended the episode with the step, (N, L).
      truncated: whether the time limit ended the episode with the step, (N, L).
      mask: whether it is a step of the episode, (N, L).
      seeds: of the episodes, (N,).
      steps: the number of the first step in its episode, (N,); negative in padding.
      returns_to_go: the discounted rewards from each step to the episode's end, (N, L). None
        without `discount`.
    """

    observations: Mapping[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    mask: np.ndarray
    seeds: np.ndarray
    steps: np.ndarray
    returns_to_go: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.rewards)


_T = TypeVar("_T", Batch, Windows)
_T_co = TypeVar("_T_co", Batch, Windows, covariant=True)


@dataclasses.dataclass(frozen=True)
class Reading:
    """The choices of `Dataset.select`.

    Attributes:
      observations: the names of those that are read; None for all.
      float32: numbers of 64 bits as ones of 32.
      discount: of a reward one step later; None if there are no discounts and returns.
      n_step: the most steps of a transition.
    """

    observations: tuple[str, ...] | None = None
    float32: bool = False
    discount: float | None = None
    n_step: int = 1

    def converted(self, values: np.ndarray) -> np.ndarray:
        """The values in the type in which they are read."""
        return values.astype(Kept(float32=self.float32).observed_type(values.dtype), copy=False)


@dataclasses.dataclass(frozen=True)
class Form:
    """Windows of `length` steps.

    Each begins `stride` steps after the one before, the first one `before` steps before its
    episode, and none ends more than `after` steps after it.
    """

    length: int
    stride: int = 1
    before: int = 0
    after: int = 0

    def counts(self, lengths: np.ndarray) -> np.ndarray:
        """The numbers of windows in episodes of some numbers of steps."""
        spare = lengths + (self.before + self.after - self.length)
        return np.maximum(spare // self.stride + 1, 0)


class Rows:
    """The steps of some episodes: a row for each, and in observations one for the last of each.

    It is a `Source` of transitions.
    """

    def __init__(self, episodes: Sequence[Episode], reading: Reading) -> None:
        """Copies the arrays of at least one episode."""
        self._reading = reading
        self._observations = {
            name: reading.converted(np.concatenate([e.observations[name] for e in episodes]))
            for name in episodes[0].observations
        }
        actions, rewards, self._terminated, self._truncated = (
            np.concatenate([getattr(episode, name) for episode in episodes])
            for name in ("actions", "rewards", "terminated", "truncated")
        )
        self._actions = reading.converted(actions)
        self._seeds = np.array([episode.seed for episode in episodes])
        self.lengths = lengths = np.array([episode.length for episode in episodes])
        self._ends = np.cumsum(lengths)
        # The row of a step: those of all steps before it, and a last one of each earlier episode.
        self._row = np.arange(lengths.sum()) + np.repeat(np.arange(len(lengths)), lengths)
        self._to_go: np.ndarray | None = None
        # Rewards of single steps, as in windows, and the sums of transitions.
        self._rewards = self._summed = reading.converted(rewards)
        if reading.discount is not None:
            self._to_go = reading.converted(self._returns(rewards, reading.discount))
            if reading.n_step > 1:
                self._left = np.repeat(self._ends, lengths) - np.arange(len(rewards))
                sums = self._sums(rewards, reading.discount, reading.n_step)
                self._summed = reading.converted(sums)

    def __len__(self) -> int:
        return len(self._row)

    @property
    def nbytes(self) -> int:
        """The size of the numbers in memory, about."""
        arrays = [*self._observations.values(), self._actions, self._rewards, self._row]
        return sum(array.nbytes for array in arrays)

    def _returns(self, rewards: np.ndarray, discount: float) -> np.ndarray:
        """The discounted sum of each step's reward and those that follow in its episode."""
        order = np.argsort(-self.lengths, kind="stable")
        ends = self._ends[order]
        found = rewards.copy()  # of the last steps
        # One step of all episodes that have it at a time, from their ends.
        more = np.searchsorted(-self.lengths[order], -np.arange(1, self.lengths.max()), "left")
        for back, count in enumerate(more, start=2):
            steps = ends[:count] - back
            found[steps] += discount * found[steps + 1]
        return found

    def _sums(self, rewards: np.ndarray, discount: float, n_step: int) -> np.ndarray:
        """The discounted sum of each step's reward and of up to n - 1 that follow."""
        found = rewards.copy()
        for ahead in range(1, min(n_step, int(self.lengths.max()))):
            has = np.flatnonzero(self._left > ahead)
            found[has] += discount**ahead * rewards[has + ahead]
        return found

    def take(self, steps: np.ndarray, /) -> Batch:
        """The transitions of some steps, (N,)."""
        rows, last, taken = self._row.take(steps), steps, None
        discount = self._reading.discount
        if self._reading.n_step > 1:
            taken = np.minimum(self._left.take(steps), self._reading.n_step)
            last = steps + (taken - 1)
        after = self._row.take(last) + 1 if last is not steps else rows + 1
        terminated = self._terminated.take(last)
        discounts = None
        if discount is not None:
            power = np.full(len(steps), discount) if taken is None else discount**taken
            discounts = self._reading.converted(np.where(terminated, 0.0, power))
        return Batch(
            {name: values.take(rows, axis=0) for name, values in self._observations.items()},
            self._actions.take(steps, axis=0),
            self._summed.take(steps),
            {name: values.take(after, axis=0) for name, values in self._observations.items()},
            terminated,
            self._truncated.take(last),
            discounts,
            None if self._to_go is None else self._to_go.take(steps),
        )

    def windows(self, episodes: np.ndarray, first: np.ndarray, length: int) -> Windows:
        """Windows, by the numbers of their episodes and of their first steps, (N,) both."""
        lengths = self.lengths[episodes][:, None]
        begins = self._ends[episodes][:, None] - lengths
        steps = first[:, None] + np.arange(length + 1)
        mask = (steps[:, :-1] >= 0) & (steps[:, :-1] < lengths)
        is_padded = not mask.all()
        inside = np.clip(steps, 0, lengths) if is_padded else steps
        rows = inside + (begins + episodes[:, None])
        at = begins + (np.minimum(inside[:, :-1], lengths - 1) if is_padded else inside[:, :-1])

        def of_steps(values: np.ndarray) -> np.ndarray:
            found = values.take(at)
            if is_padded:
                found[~mask] = 0
            return found

        return Windows(
            {name: values.take(rows, axis=0) for name, values in self._observations.items()},
            self._actions.take(at, axis=0),
            of_steps(self._rewards),
            of_steps(self._terminated),
            of_steps(self._truncated),
            mask,
            self._seeds[episodes],
            first.copy(),
            None if self._to_go is None else of_steps(self._to_go),
        )


class WindowsOf:
    """All windows of a form in some rows, in order of episodes and steps; a `Source`."""

    def __init__(self, rows: Rows, form: Form) -> None:
        """Numbers the windows."""
        self._rows, self._form = rows, form
        counts = form.counts(rows.lengths)
        self._episodes = np.repeat(np.arange(len(counts)), counts)
        number = np.arange(len(self._episodes)) - np.repeat(np.cumsum(counts) - counts, counts)
        self._first = number * form.stride - form.before

    def __len__(self) -> int:
        return len(self._episodes)

    def take(self, which: np.ndarray, /) -> Windows:
        """Some of the windows, by their numbers, (N,)."""
        return self._rows.windows(self._episodes[which], self._first[which], self._form.length)


class Source(Protocol[_T_co]):
    """Something that has a number of transitions or windows."""

    def __len__(self) -> int:
        """Their number."""
        ...

    def take(self, which: np.ndarray, /) -> _T_co:
        """Some of them, by their numbers, (N,)."""
        ...


def _applied(do: Callable[[list[np.ndarray]], np.ndarray], parts: Sequence[_T]) -> _T:
    """The result of a function for each array, called with those of all parts."""

    def of(name: str) -> object:
        values = [getattr(part, name) for part in parts]
        if isinstance(values[0], Mapping):
            return {key: do([one[key] for one in values]) for key in values[0]}
        return None if values[0] is None else do(values)

    names = [field.name for field in dataclasses.fields(parts[0])]
    return dataclasses.replace(parts[0], **{name: of(name) for name in names})


def joined(parts: Sequence[_T]) -> _T:
    """The transitions or windows of at least one part, one after the other."""
    return _applied(np.concatenate, parts)


def taken(part: _T, which: np.ndarray) -> _T:
    """Some of the transitions or windows, by their numbers, (N,)."""
    return _applied(lambda values: values[0].take(which, axis=0), [part])


class _Taken(Generic[_T]):
    """Transitions or windows that are in memory, as a `Source`."""

    def __init__(self, part: _T) -> None:
        self._part = part

    def __len__(self) -> int:
        return len(self._part)

    def take(self, which: np.ndarray, /) -> _T:
        return taken(self._part, which)


def stream(
    sources: Iterable[Source[_T]],
    size: int,
    random: np.random.Generator | None = None,
    buffer: int = 0,
) -> Iterator[_T]:
    """All of the sources once, in batches of `size`; the last one may be smaller.

    Args:
      sources: in their order; one is in memory at a time.
      size: of a batch.
      random: shuffles each source; None for the order in which they are.
      buffer: of so many, drawn at random, the turn comes later, and they are shuffled with the
        source that follows. The order depends on the stream and this number, not on `size`.
    """
    left: list[_T] = []
    held: _T | None = None
    for source in sources:
        if not len(source):
            continue
        if random is None:
            left = yield from _cut(source, np.arange(len(source)), size, left)
            continue
        pool: Source[_T] = source
        if held is not None:
            whole = source.take(np.arange(len(source)))
            pool = _Taken(joined([held, whole]))
        order = random.permutation(len(pool))
        leaving = max(len(order) - buffer, 0)
        left = yield from _cut(pool, order[:leaving], size, left)
        held = pool.take(order[leaving:]) if leaving < len(order) else None
    if held is not None:
        assert random is not None
        left = yield from _cut(_Taken(held), random.permutation(len(held)), size, left)
    if left:
        yield joined(left)


def _cut(
    source: Source[_T], order: np.ndarray, size: int, left: list[_T]
) -> Generator[_T, None, list[_T]]:
    """Batches of a source, after what was left of the one before; returns the rest."""
    first = size - sum(map(len, left)) if left else 0
    if first > len(order):
        return [*left, source.take(order)] if len(order) else left
    if left:
        yield joined([*left, source.take(order[:first])])
    whole = first + (len(order) - first) // size * size
    for begin in range(first, whole, size):
        yield source.take(order[begin : begin + size])
    return [source.take(order[whole:])] if whole < len(order) else []


class Recent:
    """The episodes that were read last, up to a number of bytes; a pickled copy has none.

    recent = Recent(2**29)
    rows = recent.get(5) or recent.put(5, Rows([episode]))
    """

    def __init__(self, most_bytes: int) -> None:
        """Has none yet."""
        self._most_bytes = most_bytes
        self._rows: collections.OrderedDict[Hashable, Rows] = collections.OrderedDict()
        self._nbytes = 0

    def __getstate__(self) -> dict[str, object]:
        return {"_most_bytes": self._most_bytes, "_rows": collections.OrderedDict(), "_nbytes": 0}

    def get(self, key: Hashable) -> Rows | None:
        """The episode that was put, unless others have taken its room."""
        rows = self._rows.get(key)
        if rows is not None:
            self._rows.move_to_end(key)
        return rows

    def put(self, key: Hashable, rows: Rows) -> Rows:
        """Keeps an episode in the place of those that were not used for the longest time."""
        self._rows[key] = rows
        self._nbytes += rows.nbytes
        while self._nbytes > self._most_bytes and len(self._rows) > 1:
            _, oldest = self._rows.popitem(last=False)
            self._nbytes -= oldest.nbytes
        return rows
