"""Tests of limberjack.utils.xml_tools, on the standard library's elements and on lxml's."""

import importlib
import io
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import pytest

from limberjack.utils import xml_tools

XML = """
<mujoco>
  <worldbody name="world">
    <body name="arm">
      <geom name="arm"/>
      <body name="hand"/>
    </body>
    <body name="ball"/>
    <body/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(params=["xml.etree.ElementTree", "lxml.etree"])
def etree(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "lxml.etree":
        return pytest.importorskip(request.param, reason="lxml is not installed")
    return importlib.import_module(request.param)


def parents_and_children(root: Any) -> list[tuple[str, list[str]]]:
    return [(parent.tag, [child.get("name") for child in parent]) for parent in root.iter()]


def test_an_element_is_found_by_tag_and_name_at_any_depth(etree: ModuleType) -> None:
    root = etree.fromstring(XML)
    hand = xml_tools.find_element(root, "body", "hand")
    assert (hand.tag, hand.get("name")) == ("body", "hand")
    assert xml_tools.find_element(root, "geom", "arm").tag == "geom"
    assert xml_tools.find_element(root=root, tag="body", name="arm").tag == "body"


def test_a_tree_serves_as_its_root(etree: ModuleType) -> None:
    tree = etree.ElementTree(etree.fromstring(XML))
    assert xml_tools.find_element(tree, "body", "ball").get("name") == "ball"
    xml_tools.remove_element(tree, xml_tools.find_element(tree, "body", "ball"))
    with pytest.raises(ValueError, match="'ball' not found"):
        xml_tools.find_element(tree, "body", "ball")


def test_the_root_itself_is_not_searched(etree: ModuleType) -> None:
    world = etree.fromstring(XML)[0]
    with pytest.raises(ValueError, match="'world' not found"):
        xml_tools.find_element(world, "worldbody", "world")


@pytest.mark.parametrize("name", ["it's", 'a "name"', "]"])
def test_a_name_may_hold_any_character(etree: ModuleType, name: str) -> None:
    root = etree.Element("mujoco")
    etree.SubElement(root, "body", name=name)
    assert xml_tools.find_element(root, "body", name) is root[0]


def test_an_unknown_element_is_an_error_with_a_suggestion(etree: ModuleType) -> None:
    root = etree.fromstring(XML)
    with pytest.raises(ValueError, match=r"tag 'body' and name 'hnd' .*Did you mean 'hand'"):
        xml_tools.find_element(root, "body", "hnd")
    with pytest.raises(ValueError, match="Element with tag 'site'"):
        xml_tools.find_element(root, "site", "hand")


def test_a_removed_element_is_gone_with_its_content_and_nothing_else_is(etree: ModuleType) -> None:
    root = etree.fromstring(XML)
    xml_tools.remove_element(root, xml_tools.find_element(root, "body", "arm"))
    assert parents_and_children(root) == [
        ("mujoco", ["world"]),
        ("worldbody", ["ball", None]),
        ("body", []),
        ("body", []),
    ]


def test_equal_elements_are_distinguished(etree: ModuleType) -> None:
    root = etree.fromstring("<a><b/><c><b/></c></a>")
    inner = root[1][0]
    xml_tools.remove_element(root, inner)
    assert [element.tag for element in root.iter()] == ["a", "b", "c"]
    assert len(root[1]) == 0


def test_removing_the_root_or_a_stranger_is_refused(etree: ModuleType) -> None:
    root = etree.fromstring(XML)
    before = etree.tostring(root)
    with pytest.raises(ValueError, match="'mujoco' is not below the root 'mujoco'"):
        xml_tools.remove_element(root, root)
    with pytest.raises(ValueError, match="'body' is not below the root"):
        xml_tools.remove_element(root, etree.Element("body"))
    assert etree.tostring(root) == before


def test_nesting_puts_copies_into_copies(etree: ModuleType) -> None:
    element = etree.fromstring("<body><geom/></body>")
    assert xml_tools.nested_element(element, depth=2) is element
    assert etree.tostring(element) == (
        b"<body><geom/><body><geom/><body><geom/></body></body></body>".replace(
            b"<geom/>", etree.tostring(etree.Element("geom"))
        )
    )


def test_nesting_to_no_depth_changes_nothing(etree: ModuleType) -> None:
    element = etree.Element("body")
    assert len(xml_tools.nested_element(element, depth=0)) == 0


@pytest.fixture
def without_lxml(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "lxml.etree", raising=False)


@pytest.mark.usefixtures("without_lxml")
def test_parsing_drops_the_space_between_elements_and_keeps_text() -> None:
    tree = xml_tools.parse(io.StringIO("<a>\n  <b> kept </b>\n  <c></c>\n</a>\n"))
    assert ElementTree.tostring(tree.getroot()) == b"<a><b> kept </b><c /></a>"


@pytest.mark.usefixtures("without_lxml")
def test_parsed_xml_can_be_indented_again() -> None:
    tree = xml_tools.parse(io.StringIO("<a>  <b/></a>"))
    assert isinstance(tree, ElementTree.ElementTree)
    ElementTree.indent(tree)
    assert ElementTree.tostring(tree.getroot()) == b"<a>\n  <b />\n</a>"


def test_a_program_that_uses_lxml_gets_its_tree() -> None:
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    tree = xml_tools.parse(io.StringIO("<a>\n  <b/>\n</a>"))
    etree.SubElement(tree.getroot(), "c")
    assert etree.tostring(tree, pretty_print=True) == b"<a>\n  <b/>\n  <c/>\n</a>\n"


@pytest.mark.parametrize("library", ["xml.etree.ElementTree", "lxml.etree"])
def test_parsing_takes_a_path_a_text_file_or_a_binary_file(
    library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if library == "lxml.etree":
        pytest.importorskip(library, reason="lxml is not installed")
    else:
        monkeypatch.delitem(sys.modules, "lxml.etree", raising=False)
    path = tmp_path / "model.xml"
    path.write_text(XML)
    with path.open() as text, path.open("rb") as binary:
        for source in (str(path), path, text, binary, io.BytesIO(XML.encode())):
            assert xml_tools.parse(source).getroot().tag == "mujoco"


def test_malformed_xml_is_an_error(etree: ModuleType) -> None:
    with pytest.raises(SyntaxError):
        xml_tools.parse(io.StringIO("<a>"))
