"""`overridable`: a property that gives way to attributes of the same name.

    class Environment:
        @overridable
        def success(self) -> bool | None: ...

    class Own(Environment):
        def __init__(self):
            self.success = "mine"       # refused if `success` were a property

    Own().success                       # "mine"
    Environment.success.of(Own())       # what the function returns

Classes that programs for dm_control derive from have it for names that dm_control does not use.
"""

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

__all__ = ["overridable"]

_Value = TypeVar("_Value")


class overridable(Generic[_Value]):  # noqa: N801 (a decorator, as `property`)
    """See the module's docstring."""

    def __init__(self, read: Callable[[Any], _Value]) -> None:  # of the class that has it
        """Takes the function that computes the value from the object."""
        self.of = read
        self.__doc__ = read.__doc__

    @overload
    def __get__(self, owner: None, cls: type) -> Self: ...

    @overload
    def __get__(self, owner: object, cls: type) -> _Value: ...

    def __get__(self, owner: object | None, cls: type) -> Self | _Value:
        return self if owner is None else self.of(owner)
