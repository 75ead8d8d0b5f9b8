"""Models that are chains of bodies, each nested in the one before.

    <!-- Further poles: <body name="pole_{i}" pos="0 0 1"> <joint name="hinge_{i}"/> </body> -->

In a model's file such a comment holds templates; `repeat` replaces it by a chain or a sequence.
To MuJoCo, and to programs that read the file, it is a comment.
"""

import copy
from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

__all__ = ["checked_length", "repeat", "with_templates"]

_LONGEST = 480  # links; MuJoCo's parser refuses XML that is nested 500 elements deep


def with_templates(xml: bytes) -> Element:
    """The root of an MJCF text, with its comments."""
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.fromstring(xml, ElementTree.XMLParser(target=builder))


def repeat(parent: Element, indices: Iterable[int], **values: object) -> None:
    """Replaces the templates in the comments below an element by numbered copies, in place.

    Copies of a body are nested, copies of other elements follow each other. In the attributes,
    '{i}' becomes the index, '{next}' the index after it, and names of `values` their values.
    """
    comments = [child for child in parent if child.tag is ElementTree.Comment]
    templates: list[Element] = []
    for comment in comments:
        if "{i}" in (text := comment.text or ""):
            templates += ElementTree.fromstring(f"<comment>{text}</comment>")
            parent.remove(comment)
    end = parent
    for i in indices:
        for template in templates:
            link = copy.deepcopy(template)
            for element in link.iter():
                for name, text in element.items():
                    element.set(name, text.format(i=i, next=i + 1, **values))
            if link.tag == "body":
                end.append(link)
                end = link
            else:
                parent.append(link)


def checked_length(
    name: str, value: object, shortest: int = 1, wrong_kind: type[Exception] = ValueError
) -> int:
    """`value` as a number of links.

    Raises:
      ValueError: it is out of range, or not a whole number; `wrong_kind` for the latter if given.
    """
    message = f"{name} is {value!r}; expected a whole number from {shortest} to {_LONGEST}"
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise wrong_kind(message)
    if not shortest <= value <= _LONGEST:
        raise ValueError(message)
    return int(value)
