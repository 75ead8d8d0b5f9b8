"""`did_you_mean`: the tail of an error message about a name that is not there.

    raise ValueError(f"no task {name!r}; choose from {tasks}.{did_you_mean(name, tasks)}")

It only proposes; listing the choices is left to the message.
"""

from collections.abc import Iterable

__all__ = ["did_you_mean"]


def did_you_mean(name: object, choices: Iterable[str]) -> str:
    """` Did you mean 'x'?` for the choice nearest to `name`, or the empty string if none is near.

    Case does not count. A name that is no string has no near choice.
    """
    if not isinstance(name, str):
        return ""
    # Imported here: only the path to an error needs it.
    import difflib

    by_folded: dict[str, str] = {}
    for choice in choices:
        by_folded.setdefault(choice.casefold(), choice)
    nearest = difflib.get_close_matches(name.casefold(), by_folded, n=1)
    return f" Did you mean {by_folded[nearest[0]]!r}?" if nearest else ""
