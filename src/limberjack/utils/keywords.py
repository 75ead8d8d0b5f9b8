"""`keywords`: keyword arguments that a caller passes on in a mapping.

kwargs = keywords("task_kwargs", {"random": 0})
"""

from collections.abc import Mapping

__all__ = ["keywords"]


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
