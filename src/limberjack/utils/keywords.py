"""Keyword arguments that a caller passes on in a mapping.

kwargs = keywords("task_kwargs", {"random": 0})
kwargs = with_keywords("task_kwargs", {"random": 0}, time_limit=2.0)
"""

from collections.abc import Mapping

__all__ = ["keywords", "with_keywords"]


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


def with_keywords(
    where: str, kwargs: Mapping[str, object] | None, **given: object
) -> dict[str, object]:
    """The keyword arguments with others added.

    Args:
      where: their name, for messages.
      kwargs: the keyword arguments.
      given: the others, which are also arguments of the caller's function; None for those that are
        not given.

    Raises:
      TypeError: one is given twice, or `kwargs` is no mapping.
    """
    known = keywords(where, kwargs)
    for name, value in given.items():
        if value is not None and name in known:
            raise TypeError(f"{name} is given twice: once alone and once in {where}")
    return known | {name: value for name, value in given.items() if value is not None}
