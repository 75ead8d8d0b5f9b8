"""Finds, nests, parses and removes XML elements, based on the standard library's ElementTree.

    root = ElementTree.fromstring(xml)
    target = find_element(root, "body", "target")
    remove_element(root, target)

Elements of lxml are accepted too, and then returned: its classes have the same methods.
"""

import copy
import os
import sys
from typing import IO
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from limberjack.utils.suggest import did_you_mean

__all__ = ["find_element", "nested_element", "parse", "remove_element"]


def find_element(root: "Element | ElementTree.ElementTree", tag: str, name: str) -> Element:
    """The first descendant of `root` with this tag and `name` attribute.

    Raises:
      ValueError: there is no such element.
    """
    top = _top(root)
    elements = [element for element in top.iter(tag) if element is not top]
    for element in elements:
        if element.get("name") == name:
            return element
    names = [known for element in elements if (known := element.get("name"))]
    raise ValueError(
        f"Element with tag {tag!r} and name {name!r} not found;"
        f" the names of {tag!r} elements are {names}.{did_you_mean(name, names)}"
    )


def remove_element(root: "Element | ElementTree.ElementTree", element: Element) -> None:
    """Removes `element` and its descendants from the tree of `root`.

    Raises:
      ValueError: `element` is `root` itself or is not in the tree.
    """
    for parent in _top(root).iter():
        for child in parent:
            if child is element:
                parent.remove(element)
                return
    raise ValueError(f"the element {element.tag!r} is not below the root {_top(root).tag!r}")


def nested_element(element: Element, depth: int) -> Element:
    """`element`, with a copy of itself appended as its last child, nested `depth` copies deep."""
    single = copy.deepcopy(element)
    parent = element
    for _ in range(depth):
        child = copy.deepcopy(single)
        parent.append(child)
        parent = child
    return element


def parse(
    file_obj: IO[str] | IO[bytes] | str | os.PathLike[str],
) -> "ElementTree.ElementTree[Element]":
    """The tree of an XML file, without the whitespace between its elements.

    A pretty printer can then indent it. The result is an `xml.etree.ElementTree.ElementTree`
    without comments; if the program has imported `lxml.etree`, it is an lxml tree as in dm_control,
    because lxml's functions accept no other.

    Args:
      file_obj: an open file, of text or of bytes, or a path.

    Raises:
      SyntaxError: the file is not well-formed XML (`ParseError` or `XMLSyntaxError`).
    """
    lxml = sys.modules.get("lxml.etree")
    if lxml is not None:
        return lxml.parse(file_obj, lxml.XMLParser(remove_blank_text=True))
    tree = ElementTree.parse(file_obj)
    for element in tree.iter():
        if element.text is not None and not element.text.strip():
            element.text = None
        if element.tail is not None and not element.tail.strip():
            element.tail = None
    return tree


def _top(root: "Element | ElementTree.ElementTree") -> Element:
    """The root element of a tree, or the element itself."""
    return next(root.iter("*"))  # xml.etree and lxml have no class in common to distinguish them by
