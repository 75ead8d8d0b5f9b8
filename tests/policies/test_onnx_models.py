"""The bytes of models of ONNX: what is written, and what is refused before a runtime sees it."""

import dataclasses

import numpy as np
import pytest

from limberjack.policies import mlp, onnx_models
from limberjack.policies.onnx_models import _fields, _Graph, _message, _varint
from tests.policies.network_files import drawn

CARD = mlp.Card((("angle", (2,)), ("speed", ())), (-1.0,), (2.0,), sizes=(3, 4, 1))


def content() -> bytes:
    """A model with a card."""
    policy = mlp.Mlp(drawn(3, 4, 1), CARD)
    return onnx_models.with_card(onnx_models.model_of(policy), policy.card)


def with_graph(*fields: tuple[int, int | bytes | str], carded: bool = True) -> bytes:
    """A model of a graph with these fields."""
    model = _message((1, 8), (8, _message((1, ""), (2, 17))), (7, _message(*fields)))
    return onnx_models.with_card(model, CARD) if carded else model


def with_node(*fields: tuple[int, int | bytes | str]) -> bytes:
    """A model of a graph with one node."""
    return with_graph((1, _message(*fields)))


_INSIDE = _message((8, "x"), (13, _message((1, "location"), (2, "/etc/passwd"))), (14, 1))
REFUSED = {
    "nothing": (b"", "it is cut off, or not in the format ONNX"),
    "a text": (b"weights of the walker\n" * 40, "field|cut off"),
    "a pickle": (b"\x80\x04\x95\x1d\x00\x00\x00\x00\x00\x00\x00cposix\nsystem\n(S'true'\ntR.", "f"),
    "no card": (with_graph(carded=False), "its metadata has 0 cards"),
    "two cards": (content() + content(), "cut off|2 cards"),
    "two graphs": (with_graph() + with_graph(carded=False), "cut off"),
    "a key without an end": (b"\xff" * 20, "cut off"),
    "a group": (b"\x0b\x0c", "cut off"),
    "a length beyond the end": (b"\x3a\xff\xff\xff\xff\x0f", "cut off"),
    "functions": (content() + _message((25, b"")), "it has functions, which no policy needs"),
    "a training": (content() + _message((20, b"")), "it has a training"),
    "other operators": (content() + _message((8, _message((1, "evil")))), "operators of 'evil'"),
    "a node of others": (with_node((4, "Relu"), (7, "com.microsoft")), "of 'com.microsoft'"),
    "a domain that is no text": (with_node((4, "Relu"), (7, b"\xff")), "utf-8"),
    "a loop": (
        with_node((4, "Loop"), (5, _message((1, "body"), (6, b"")))),
        "it has a branch or a loop",
    ),
    "branches": (with_node((4, "If"), (5, _message((11, b"")))), "it has branches"),
    "random numbers": (with_node((4, "RandomNormal")), "random numbers, with RandomNormal"),
    "numbers in a file": (with_graph((5, _INSIDE)), "it has numbers in another file"),
    "a place in a file": (with_graph((5, _message((14, 1)))), "it has numbers in another file"),
    "a file in an attribute": (
        with_node((4, "Constant"), (5, _message((1, "value"), (5, _INSIDE)))),
        "it has numbers in another file",
    ),
    "a file in a list": (
        with_node((4, "Constant"), (5, _message((10, _INSIDE)))),
        "it has numbers in another file",
    ),
    "sparse constants": (with_graph((15, b"")), "it has sparse constants"),
    "an unknown field": (with_graph((99, b"")), "the field 99 of a graph"),
}


def test_the_card_is_in_the_metadata() -> None:
    assert mlp.Card.of_text(onnx_models.checked(content())) == CARD


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


@pytest.mark.parametrize("value", [0, 1, 127, 128, 300, 2**32, 2**63 - 1])
def test_whole_numbers_are_read_as_they_were_written(value: int) -> None:
    ((number, found),) = _fields(_message((3, value)), (3,), "test")
    assert number == 3
    assert found == _varint(value)


def test_numbers_are_written_with_the_lowest_byte_first() -> None:
    graph = _Graph()
    graph.constant(np.array([1.0, -2.5]), np.float64)
    assert np.array([1.0, -2.5], "<f8").tobytes() in graph.model(1, 1)


def test_a_place_in_the_model_is_accepted() -> None:
    onnx_models.checked(with_graph((5, _message((8, "x"), (14, 0)))))


def test_an_entry_of_metadata_of_another_name_is_ignored() -> None:
    more = _message((14, _message((1, "author"), (2, "somebody"))))
    assert mlp.Card.of_text(onnx_models.checked(content() + more)) == CARD


def test_a_card_is_added_to_a_model_that_is_not_read() -> None:
    other = dataclasses.replace(CARD, domain="swing")
    made = onnx_models.with_card(with_graph(carded=False), other)
    assert mlp.Card.of_text(onnx_models.checked(made)).domain == "swing"
