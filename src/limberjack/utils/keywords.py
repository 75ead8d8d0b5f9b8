"""Keyword arguments that a caller passes on in a mapping.

kwargs = keywords("task_kwargs", {"random": 0})
kwargs = with_keyword("time_limit", 2.0, {"random": 0}, "task_kwargs")
"""

from collections.abc import Mapping

__all__ = ["keywords", "with_keyword"]


def keywords(name: str, given: Mapping[str, object] | None) -> dict[str, object]:
    """A new dict of the keyword arguments, empty for None.

    Args:
      name: the argument's name, for messages.
      given: a mapping, or an object that `dict` accepts.

    Raises:
      TypeError: it is neither.
    """
    try:
        return dict(given or {})
    except (TypeError, ValueError):
        raise TypeError(
            f"{name} is {given!r}; expected a mapping of keyword arguments, or None"
        ) from None


def with_keyword(
    name: str, value: object, kwargs: Mapping[str, object] | None, where: str
) -> dict[str, object]:
    """The keyword arguments with one added, unless its value is None.

    Args:
      name: of the argument.
      value: of the argument, which is also an argument of the caller's function.
      kwargs: the others.
      where: their name, for messages.

    Raises:
      TypeError: it is given twice, or `kwargs` is no mapping.
    """
    known = keywords(where, kwargs)
    if value is None:
        return known
    if name in known:
        raise TypeError(f"{name} is given twice: once alone and once in {where}")
    return {**known, name: value}
