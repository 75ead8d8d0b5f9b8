"""`EpisodeAttributes`: what a task remembers of each row's episode in a vectorised batch.

    class Smooth(base.Task):
        EPISODE_ATTRIBUTES = ("last_action",)           # an array of (nu,), set in __init__

    memory = EpisodeAttributes(task, num_envs=64)       # task.last_action is now (64, nu)
    with memory.during("before_step", physics, rows):   # rows: a mask of the rows that step
        task.before_step(actions, physics)
    with memory.of_row(3, one):                         # task.last_action is (nu,), of row 3
        task.initialize_episode(one)

A task declares numbers and arrays whose shape and dtype never change. In a batch each is one array
with a leading axis of rows. A hook is called for all rows at once; rows whose single environment
would not have called it get their values back. Values are copied in and out.

All other attributes are shared by all rows. A hook that changes one, or a hook of a step that draws
from the task's stream, would give wrong numbers and raises `NotVectorised`, here as in the check at
creation.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from limberjack.rl.batch_errors import NotVectorised
from limberjack.rl.episode_values import NAME, declared, in_dtype
from limberjack.rl.references import attributes_of
from limberjack.rl.watch import QuickWatch
from limberjack.utils.suggest import did_you_mean

__all__ = ["KEEP_IT", "EpisodeAttributes", "advice", "check_declared"]

_FORM = "numbers and arrays of numbers whose shape and dtype never change"
# Advice for a task that remembers something else.
KEEP_IT = (
    f"keep it in {_FORM}, such as a ring array for the last few, and declare them in {NAME}, so "
    "that each row has its own"
)
_KINDS = "fiub"  # kinds of dtypes that an attribute may have
_STREAM = "_random"  # of a task, which a batch replaces by each row's
_NOTHING = contextlib.nullcontext()


class _Form(NamedTuple):
    """The form of an attribute in a single environment."""

    shape: tuple[int, ...]
    dtype: np.dtype
    kind: type

    def single(self, value: np.ndarray) -> object:
        """One row's value, as a single environment has it."""
        if self.kind is np.ndarray:
            return np.array(value)
        return value[()] if self.kind is np.generic else self.kind(value)


def check_declared(task: object) -> None:
    """Checks that a task has the attributes that it declares, before its first episode.

    Raises:
      TypeError: see `episode_values.declared`.
      NotVectorised: there is no such attribute, or it is no number or array of numbers.
    """
    for name in declared(task):
        _form_of(task, name)


def advice(task: object, names: Sequence[str]) -> str:
    """Advice for a task that remembers attributes without declaring them."""
    values = [getattr(task, name, None) for name in names]
    if all(_is_number_or_array(value) for value in values):
        whole = tuple(sorted({*declared(task), *names}))
        return f"declare {NAME} = {whole}, with {_FORM}, and each row has its own"
    return KEEP_IT


class EpisodeAttributes:
    """See the module's docstring.

    Attributes:
      names: of the attributes that the task declares.
      is_idle: whether the task is known to remember nothing, so that it is not watched.
    """

    def __init__(self, task: object, num_envs: int, is_proved: bool = False) -> None:
        """Gives each row the values that the task has, in arrays of (num_envs, ...).

        Args:
          task: a task with the values from before its first episode, which is changed.
          num_envs: number of rows.
          is_proved: whether the task is known to remember nothing.

        Raises:
          NotVectorised: an attribute is declared that cannot be kept for each row.
        """
        self._task = task
        self._count = num_envs
        self.is_idle = is_proved
        self._why_not: str | None = None  # once the task has changed what rows share
        self.names: tuple[str, ...] = () if is_proved else declared(task)
        self._forms = {name: _form_of(task, name) for name in self.names}
        # The values of rows before the first episode of a seed.
        self._first = {
            name: np.stack([np.asarray(getattr(task, name))] * num_envs) for name in self.names
        }
        self._of_task = QuickWatch("self", task, self.names)
        self._watches: dict[int, QuickWatch] = {}  # of each physics that hooks are called with
        self._set({name: values.copy() for name, values in self._first.items()})

    def during(
        self, hook: str, physics: object, rows: np.ndarray | None = None
    ) -> contextlib.AbstractContextManager[None]:
        """A context in which a hook is called for all rows at once.

        Args:
          hook: its name.
          physics: that it is called with.
          rows: mask of rows for which the hook counts, (num_envs,); None for all.

        Raises:
          NotVectorised: the hook changes what rows share, draws, or sets an attribute to a value of
            another form.
        """
        return _NOTHING if self.is_idle else self._during(hook, physics, rows)

    @contextlib.contextmanager
    def _during(self, hook: str, physics: object, rows: np.ndarray | None) -> Iterator[None]:
        task = self._task
        before = {name: getattr(task, name) for name in self.names}
        values = {n: self._of_rows(n, value, "an assignment") for n, value in before.items()}
        watches = self._look(physics)
        self._set({name: value.copy() for name, value in values.items()})
        # During a step the task has the stream of the row that began an episode last.
        stream, refusing = getattr(task, _STREAM, None), _Refusing(type(task).__name__, hook)
        if is_stream := isinstance(stream, np.random.RandomState):
            task._random = refusing  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
            self._check(watches, hook)
            if rows is None or rows.any():
                before = {n: self._counted(n, value, rows, hook) for n, value in values.items()}
        finally:
            if is_stream and getattr(task, _STREAM, None) is refusing:
                task._random = stream  # pyright: ignore[reportAttributeAccessIssue]
            self._set(before)

    def _counted(
        self, name: str, before: np.ndarray, rows: np.ndarray | None, hook: str
    ) -> np.ndarray:
        """The values set by a hook in a mask of rows, None for all; the old ones in the others."""
        new = np.array(self._of_rows(name, getattr(self._task, name), hook))
        if rows is not None:
            new[~rows] = before[~rows]
        return new

    def of_row(
        self, row: int, physics: object, hook: str = "initialize_episode"
    ) -> contextlib.AbstractContextManager[None]:
        """A context in which the attributes are those of one row, as in a single environment.

        Args:
          row: its number.
          physics: its single simulation.
          hook: that is called.

        Raises:
          NotVectorised: the hook changes what rows share, or sets an attribute to a value of
            another form.
        """
        return _NOTHING if self.is_idle else self._of_row(row, physics, hook)

    @contextlib.contextmanager
    def _of_row(self, row: int, physics: object, hook: str) -> Iterator[None]:
        before = {name: getattr(self._task, name) for name in self.names}
        watches = self._look(physics)
        self._set({n: self._forms[n].single(values[row]) for n, values in before.items()})
        try:
            yield
            self._check(watches, hook)
            after = {}
            for name, values in before.items():
                after[name] = values.copy()
                after[name][row] = self._of_one(name, getattr(self._task, name), hook)
            before = after
        finally:
            self._set(before)

    def begin_again(self, rows: Sequence[int]) -> None:
        """Gives rows the values from before their first episode, as for a new seed."""
        for name in self.names:
            values = np.array(getattr(self._task, name))
            values[rows] = self._first[name][rows]
            self._set({name: values})

    def of_rows(self, rows: np.ndarray) -> list[dict[str, object]]:
        """The values of rows, each as a single environment has it."""
        values = {name: np.asarray(getattr(self._task, name)) for name in self.names}
        return [
            {name: self._forms[name].single(value[row]) for name, value in values.items()}
            for row in rows.tolist()
        ]

    def load(self, rows: np.ndarray, values: Sequence[Mapping[str, object]]) -> None:
        """Sets the values of rows; those that are missing stay.

        Raises:
          ValueError: a value has another form; nothing is set.
        """
        self._set(self._loaded(rows, values))

    def check(self, values: Sequence[Mapping[str, object]]) -> None:
        """Raises the ValueError that `load` would raise for some rows' values."""
        self._loaded(np.zeros(len(values), int), values)

    def _loaded(
        self, rows: np.ndarray, values: Sequence[Mapping[str, object]]
    ) -> dict[str, np.ndarray]:
        """The values of all rows, with others in some of them."""
        new = {name: np.array(getattr(self._task, name)) for name in self.names}
        for row, given in zip(rows.tolist(), values, strict=True):
            for name in self.names:
                if name in given:
                    new[name][row] = self._of_one(name, given[name], "a snapshot")
        return new

    def keep_as_first(self, name: str) -> None:
        """Makes `begin_again` give rows the values that an attribute has now."""
        self._first[name] = self._of_rows(name, getattr(self._task, name), "set_attr").copy()

    def _set(self, values: Mapping[str, object]) -> None:
        for name, value in values.items():
            setattr(self._task, name, value)

    def _of_rows(self, name: str, given: object, hook: str) -> np.ndarray:
        """The value that a hook has set for all rows, as an array of (num_envs, ...)."""
        form = self._forms[name]
        value = self._numbers(name, given, hook)
        whole = (self._count, *form.shape)
        if value.shape not in (whole, form.shape):
            raise self._other_form(name, value, hook, whole)
        return np.broadcast_to(value, whole)

    def _of_one(self, name: str, given: object, hook: str) -> np.ndarray:
        """The value that a hook has set for one row."""
        value = self._numbers(name, given, hook)
        if value.shape != self._forms[name].shape:
            raise self._other_form(name, value, hook, self._forms[name].shape)
        return value

    def _numbers(self, name: str, given: object, hook: str) -> np.ndarray:
        """The value in the declared dtype if it fits; a Python integer may stand for a float."""
        form = self._forms[name]
        value = in_dtype(np.asarray(given), form.dtype)
        if type(given) is int and form.dtype.kind in "fiu":
            value = value.astype(form.dtype)
        if value.dtype != form.dtype:
            raise self._other_form(name, value, hook, form.shape)
        return value

    def _other_form(
        self, name: str, value: np.ndarray, hook: str, shape: tuple[int, ...]
    ) -> NotVectorised:
        return NotVectorised(
            f"{hook} of task {type(self._task).__name__} set self.{name} to shape {value.shape} "
            f"and dtype {value.dtype}; expected {shape} and {self._forms[name].dtype}, since "
            f"{NAME} declares {_FORM}"
        )

    def _look(self, physics: object) -> list[QuickWatch]:
        """Begins to watch what rows share."""
        if self._why_not is not None:
            raise NotVectorised(self._why_not)
        key = id(physics)
        if key not in self._watches:
            self._watches[key] = QuickWatch("physics", physics)  # which keeps it
        watches = [self._of_task, self._watches[key]]
        for watch in watches:
            watch.look()
        return watches

    def _check(self, watches: Sequence[QuickWatch], hook: str) -> None:
        """Raises NotVectorised if a hook has changed what rows share; the batch stays unusable."""
        changed = [label for watch in watches for label in watch.changed()]
        if changed:
            named = [label.removeprefix("self.") for label in changed if label.startswith("self.")]
            self._why_not = (
                f"task {type(self._task).__name__} set {', '.join(changed)} in {hook}, which all "
                f"rows of a vectorised batch share: {advice(self._task, named)}; or make the batch "
                "of complete environments, with limberjack.rl.batch_of(..., vectorised=False)"
            )
            raise NotVectorised(self._why_not)

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "_watches"}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state, _watches={})


class _Refusing:
    """Stands for a random stream where nothing may be drawn."""

    def __init__(self, task: str, hook: str) -> None:
        self._task, self._hook = task, hook

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotVectorised(
            f"task {self._task} draws from the task's random stream in {self._hook}, and all rows "
            "of a vectorised batch would get one draw: draw in initialize_episode"
        )


def _form_of(task: object, name: str) -> _Form:
    """The form of a declared attribute."""
    cls = type(task).__name__
    if not hasattr(task, name):
        known = [one for one in attributes_of(task) if not one.startswith("_")]
        raise NotVectorised(
            f"task {cls} declares {name!r} in {NAME}, but has no such attribute before its first "
            f"episode.{did_you_mean(name, known)} Set it in __init__"
        )
    value = getattr(task, name)
    if not _is_number_or_array(value):
        raise NotVectorised(
            f"task {cls} declares {name!r} in {NAME}, which is {value!r} before its first "
            f"episode; expected {_FORM}, such as a ring array for the last few"
        )
    array = np.asarray(value)
    kinds = (np.ndarray, np.generic, bool, int, float)  # not subclasses, of other constructors
    kind = next(one for one in kinds if isinstance(value, one))
    return _Form(array.shape, array.dtype, kind)


def _is_number_or_array(value: object) -> bool:
    if not isinstance(value, bool | int | float | np.generic | np.ndarray):
        return False
    return np.asarray(value).dtype.kind in _KINDS
