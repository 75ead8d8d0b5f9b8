"""`did_you_mean`: the end of an error message about an unknown name; `check_names` raises one.

    raise ValueError(f"no task {name!r}; choose from {tasks}.{did_you_mean(name, tasks)}")
    check_names("pixels has no option", options, ["camera", "height", "width"])

It suggests the closest name only; the message itself lists the choices.
"""

from collections.abc import Iterable

__all__ = ["check_names", "did_you_mean"]


def did_you_mean(name: object, choices: Iterable[str]) -> str:
    """` Did you mean 'x'?` for the choice closest to `name`, or '' if none is close.

    Case is ignored. A name that is not a string has no close choice.
    """
    if not isinstance(name, str):
        return ""
    # Imported lazily: only error paths need it.
    import difflib

    by_folded: dict[str, str] = {}
    for choice in choices:
        by_folded.setdefault(choice.casefold(), choice)
    nearest = difflib.get_close_matches(name.casefold(), by_folded, n=1)
    return f" Did you mean {by_folded[nearest[0]]!r}?" if nearest else ""


def check_names(problem: str, given: Iterable[object], known: Iterable[str]) -> None:
    """Raises TypeError for the first name that is not known.

    Args:
      problem: the beginning of the message, before the name.
      given: the names to check.
      known: all names that are accepted, which the message lists.
    """
    known = list(known)
    for name in given:
        if name not in known:
            raise TypeError(
                f"{problem} {name!r}.{did_you_mean(name, known)} It takes: {', '.join(known)}."
            )
