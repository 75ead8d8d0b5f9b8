"""Tests of limberjack.suite._chain."""

from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from limberjack.suite import _chain, cartpole, swimmer

_TEMPLATES = b"""
<robot>
  <!-- Not a template. -->
  <body name="first"/>
  <!-- Links: <body name="link_{i}" pos="{length} 0 0"><joint name="joint_{i}"/></body> -->
  <!-- <motor name="motor_{i}" joint="joint_{i}"/>
       <tendon name="tendon_{i}" to="link_{next}"/> -->
</robot>
"""


def _repeated(count: int) -> ElementTree.Element:
    root = _chain.with_templates(_TEMPLATES)
    _chain.repeat(root, range(count), length=0.5)
    return root


def test_bodies_are_nested_in_each_other() -> None:
    root = _repeated(3)
    for i in range(3):
        (link,) = root.iterfind("./" + "body/" * i + f"body[@name='link_{i}']")
        assert link.get("pos") == "0.5 0 0"
        assert [joint.get("name") for joint in link.findall("joint")] == [f"joint_{i}"]


def test_other_elements_follow_each_other_and_the_rest_stays() -> None:
    root = _repeated(2)
    names = [element.get("name") for element in root if element.tag is not ElementTree.Comment]
    assert names == ["first", "link_0", "motor_0", "tendon_0", "motor_1", "tendon_1"]
    assert [tendon.get("to") for tendon in root.findall("tendon")] == ["link_1", "link_2"]


def test_a_chain_without_links_has_no_template_left() -> None:
    root = _repeated(0)
    assert [element.get("name") for element in root if element.get("name")] == ["first"]
    assert b"{i}" not in ElementTree.tostring(root)


_BAD: list[Any] = [True, 3.0, "3", None, np.nan, -1, 481, 10**6]


@pytest.mark.parametrize("number", _BAD)
@pytest.mark.parametrize(
    ("make", "shortest", "name"),
    [
        (lambda n: cartpole.three_poles(num_poles=n), 1, "num_poles"),
        (cartpole.get_model_and_assets, 1, "num_poles"),
        (swimmer.swimmer, 3, "n_links"),
        (swimmer.get_model_and_assets, 3, "n_joints"),
    ],
)
def test_another_number_than_a_whole_one_in_range_is_refused(
    make: Callable[[Any], object], shortest: int, name: str, number: Any
) -> None:
    for bad in (number, shortest - 1):
        with pytest.raises(ValueError, match=name) as refused:
            make(bad)
        expected = f"{name} is {bad!r}; expected a whole number from {shortest} to"
        assert str(refused.value).startswith(expected)


@pytest.mark.parametrize("make", [cartpole.get_model_and_assets, swimmer.get_model_and_assets])
def test_the_longest_chain_compiles(make: Callable[[Any], Any]) -> None:
    physics = cartpole.Physics.from_xml_string(*make(480))
    assert physics.model.nbody in (481, 482)
    numpy_too = make(np.int64(4))
    assert numpy_too == make(4)
