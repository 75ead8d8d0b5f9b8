"""Helpers of the functions that set a perturbed parameter in a domain's MJCF.

    set_numbers(geom_of_class(root, "pole"), "fromto", 0, 0, 0, 0, 0, length)

Parameters and their figures are those of the Real World RL suite: `_setup_perturb` and
`update_physics` in realworldrl_suite/environments/*.py of
https://github.com/google-research/realworldrl_suite, commit be7a51c.
"""

from xml.etree.ElementTree import Element

from limberjack.worlds.faults import CHALLENGES, Range

__all__ = ["challenges", "default_of", "set_numbers"]


def default_of(root: Element, name: str | None, tag: str) -> Element:
    """The element of a tag in the defaults of a class; of None in those of all elements."""
    for default in root.iter("default"):
        if default.get("class") == name:
            found = default.find(tag)
            if found is not None:
                return found
    raise ValueError(f"the model has no defaults of {tag} in class {name!r}")


def set_numbers(element: Element, attribute: str, *numbers: float) -> None:
    """Sets an attribute to numbers, with all their digits."""
    element.set(attribute, " ".join(map(repr, numbers)))


def challenges(easy: Range, medium: Range, hard: Range) -> dict[str, Range]:
    """The ranges of a parameter in the combined challenges, by name."""
    return dict(zip(CHALLENGES, (easy, medium, hard), strict=True))
