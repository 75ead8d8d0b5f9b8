"""`TaggedTasks`: the type of each domain's `SUITE`.

    SUITE = TaggedTasks()

    @SUITE.add("benchmarking", "easy")
    def swing(time_limit=10, random=None):
        ...

    SUITE["swing"]          # the factory
    SUITE.tagged("easy")    # {"swing": the factory}

A mapping from names to factories, in the order in which they were added.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping
from typing import Any, TypeVar

from limberjack.utils.suggest import did_you_mean

__all__ = ["TaggedTasks"]

_NAME_ALREADY_EXISTS = (
    "a task named {name!r} is already registered; rename the function, or make the registry with "
    "allow_overriding_keys=True to replace it"
)

# Any: a factory returns the environment of its domain, with its own types of task and physics.
_Factory = Callable[..., Any]
_F = TypeVar("_F", bound=_Factory)


class TaggedTasks(Mapping[str, _Factory]):
    """Task factories by name, each with any number of tags."""

    def __init__(self, allow_overriding_keys: bool = False) -> None:
        """Makes an empty registry.

        Args:
          allow_overriding_keys: whether a name may be registered again, replacing the factory.
        """
        self._tasks: dict[str, _Factory] = {}
        self._tags: dict[Hashable, dict[str, None]] = {}
        self.allow_overriding_keys = allow_overriding_keys

    def add(self, *tags: Hashable) -> Callable[[_F], _F]:
        """A decorator that registers a factory under its `__name__` and returns it unchanged.

        Args:
          tags: names such as 'easy', or other keys of a dictionary.

        Raises:
          TypeError: a tag cannot be a key, or is a function because the parentheses are missing.
          ValueError: when decorating, if the name is taken and may not be overridden.
        """
        for tag in tags:
            if callable(tag) or not isinstance(tag, Hashable):
                raise TypeError(
                    f"a tag is {tag!r}; expected a name (write @{type(self).__name__}.add(), "
                    "with parentheses, for a task without tags)"
                )

        def register(factory: _F) -> _F:
            name = factory.__name__
            if name in self._tasks and not self.allow_overriding_keys:
                raise ValueError(_NAME_ALREADY_EXISTS.format(name=name))
            self._tasks[name] = factory
            for tag in tags:
                self._tags.setdefault(tag, {})[name] = None
            return factory

        return register

    def tagged(self, *tags: Hashable) -> dict[str, _Factory]:
        """The factories that have all of `tags`, by name; empty if no tag is given."""
        if not tags:
            return {}
        first, *others = (self._tags.get(tag, {}) for tag in tags)
        return {name: self._tasks[name] for name in first if all(name in names for names in others)}

    def tags(self) -> list[Hashable]:
        """All tags, in the order in which they were first used."""
        return list(self._tags)

    def __getitem__(self, name: str) -> _Factory:
        try:
            return self._tasks[name]
        except KeyError:
            hint = did_you_mean(name, self._tasks)
            raise KeyError(f"no task {name!r}; there are {list(self._tasks)}.{hint}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._tasks)

    def __len__(self) -> int:
        return len(self._tasks)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._tasks})"
