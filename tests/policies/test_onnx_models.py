"""Models of ONNX: what is written, and what is refused before a runtime sees it."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from limberjack.policies import mlp
from tests.policies.network_files import drawn

# Any: the packages are found on some machines only.
onnx: Any = pytest.importorskip("onnx", reason="needs the extra 'onnx'")
onnx_models: Any = pytest.importorskip("limberjack.policies.onnx_models")

CARD = mlp.Card((("angle", (2,)), ("speed", ())), (-1.0,), (2.0,), sizes=(3, 4, 1))


def content() -> bytes:
    """A model with a card."""
    policy = mlp.Mlp(drawn(3, 4, 1), CARD)
    return onnx_models.with_card(onnx_models.model_of(policy), policy.card)


def changed(change: Callable[[Any], object]) -> bytes:
    """That model after a change."""
    model = onnx.ModelProto.FromString(content())
    change(model)
    return model.SerializeToString()


def _tensor(**parts: object) -> Any:
    return onnx.TensorProto(name="x", **parts)


def _outside() -> Any:
    """A constant whose numbers are in a file."""
    tensor = _tensor(data_location=onnx.TensorProto.EXTERNAL)
    tensor.external_data.add(key="location", value="/etc/passwd")
    return tensor


def _node(operator: str, **parts: object) -> Callable[[Any], object]:
    """Adds a node with one attribute of these parts."""

    def add(model: Any) -> None:
        node = model.graph.node.add(op_type=operator, domain=parts.pop("domain", ""))
        if parts:
            node.attribute.add(name="value", **parts)

    return add


_UNKNOWN = b"\xfa\x06\x00"  # an empty field of number 111, which the format lacks
REFUSED = {
    "nothing": (b"", "it is cut off, or not in the format ONNX"),
    "a text": (b"weights of the walker\n" * 40, "not in the format"),
    "a pickle": (
        b"\x80\x04\x95\x1d\x00\x00\x00\x00\x00\x00\x00cposix\nsystem\n(S'true'\ntR.",
        "not",
    ),
    "no card": (changed(lambda model: model.metadata_props.pop()), "its metadata has 0 cards"),
    "two cards": (content() + content(), "its metadata has 2 cards"),
    "functions": (changed(lambda model: model.functions.add()), "it has functions"),
    "a training": (changed(lambda model: model.training_info.add()), "it has a training"),
    "other operators": (
        changed(lambda model: model.opset_import.add(domain="evil")),
        "operators of 'evil'",
    ),
    "a node of others": (changed(_node("Relu", domain="com.microsoft")), "of 'com.microsoft'"),
    "a loop": (changed(_node("Loop", g=onnx.GraphProto())), "it has a branch or a loop"),
    "branches": (changed(_node("If", graphs=[onnx.GraphProto()])), "it has a branch or a loop"),
    "random numbers": (changed(_node("RandomNormal")), "random numbers, with RandomNormal"),
    "numbers in a file": (
        changed(lambda model: model.graph.initializer.append(_outside())),
        "it has numbers in another file",
    ),
    "a place in a file": (
        changed(
            lambda model: model.graph.initializer.append(
                _tensor(data_location=onnx.TensorProto.EXTERNAL)
            )
        ),
        "it has numbers in another file",
    ),
    "a file in an attribute": (
        changed(_node("Constant", t=_outside())),
        "it has numbers in another file",
    ),
    "a file in a list": (
        changed(_node("Constant", tensors=[_outside()])),
        "it has numbers in another file",
    ),
    "sparse constants": (
        changed(lambda model: model.graph.sparse_initializer.add()),
        "it has sparse constants",
    ),
    "an unknown field": (content() + _UNKNOWN, "it has fields that the format does not have"),
    "an unknown field inside": (
        changed(lambda model: model.graph.MergeFromString(_UNKNOWN)),
        "it has fields that the format does not have",
    ),
}


def test_the_card_is_in_the_metadata() -> None:
    assert mlp.Card.of_text(onnx_models.checked(content())) == CARD


def test_a_model_is_one_of_the_format() -> None:
    onnx.checker.check_model(onnx.ModelProto.FromString(content()), full_check=True)


def test_equal_networks_give_equal_bytes() -> None:
    assert content() == content()
    other = mlp.Mlp(drawn(3, 4, 1, seed=1), CARD)
    assert onnx_models.model_of(other) not in content()


@pytest.mark.parametrize("kind", REFUSED)
def test_models_that_do_more_than_arithmetic_are_refused(kind: str) -> None:
    model, message = REFUSED[kind]
    with pytest.raises(ValueError, match=message):
        onnx_models.checked(model)


def test_each_beginning_of_a_model_is_refused() -> None:
    whole = content()
    for length in range(len(whole)):
        with pytest.raises(ValueError, match=r"cut off|0 cards"):
            onnx_models.checked(whole[:length])


def test_a_text_that_is_no_text_is_refused() -> None:
    operator = b"com.microsoft"
    model = changed(_node("Relu", domain=operator.decode()))
    with pytest.raises(ValueError, match=r"utf-8|cut off|operators of"):
        onnx_models.checked(model.replace(operator, b"\xff" * len(operator)))


def test_a_place_in_the_model_is_accepted() -> None:
    inside = _tensor(data_location=onnx.TensorProto.DEFAULT, data_type=1)
    onnx_models.checked(changed(lambda model: model.graph.initializer.append(inside)))


def test_an_entry_of_metadata_of_another_name_is_ignored() -> None:
    model = changed(lambda model: model.metadata_props.add(key="author", value="somebody"))
    assert mlp.Card.of_text(onnx_models.checked(model)) == CARD


def test_a_card_is_added_to_a_model_of_another_program() -> None:
    other = dataclasses.replace(CARD, domain="swing")
    theirs = changed(lambda model: model.metadata_props.pop())
    made = onnx_models.with_card(theirs, other)
    assert mlp.Card.of_text(onnx_models.checked(made)).domain == "swing"
    with pytest.raises(ValueError, match="not in the format ONNX"):
        onnx_models.with_card(b"weights", other)
