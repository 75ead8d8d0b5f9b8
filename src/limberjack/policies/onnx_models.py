"""Models in the format ONNX: one made of a network, a card added to one, and one checked.

    content = with_card(model_of(policy), policy.card)
    text = checked(content)     # that of the card

The bytes are written and read here, after the format's public description: a model is a message of
Protocol Buffers, whose fields have numbers. `checked` reads each field that could make a runtime
do more than arithmetic, and accepts only what a policy needs: one graph of standard operators
without branches, loops, functions, random numbers, and files beside it. The numbers themselves are
left to the runtime; see `policies.onnx`.
"""

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from limberjack.policies import mlp

__all__ = ["INPUT", "OUTPUT", "checked", "model_of", "with_card"]

INPUT, OUTPUT = "observation", "action"  # names in the models that are made here

_IR_VERSION = 8  # of the format, and of its operators: both of 2022, which all runtimes read
_OPERATORS = 17
_ROWS = "N"  # the name of the first axis, whose size is not fixed

# Types of numbers and of attributes, by their number in the format.
_FLOAT, _DOUBLE = 1, 11
_OF_FLOAT, _OF_WHOLE = 1, 2
_TYPES = {np.dtype(np.float32): _FLOAT, np.dtype(np.float64): _DOUBLE}

_Value = int | float | bytes | str
_Field = tuple[int, _Value]


def model_of(policy: mlp.Mlp) -> bytes:
    """A model that acts as `policy.actions` does on (N, observations) float32.

    It rounds as the network does, save that the runtime may sum in another order.
    """
    card, graph = policy.card, _Graph()
    x = INPUT
    if card.mean is not None and card.scale is not None:
        x = graph.add("Sub", graph.cast(x, _DOUBLE), graph.constant(card.mean, np.float64))
        x = graph.add("Div", x, graph.constant(card.scale, np.float64))
        if card.clip is not None:
            limits = (graph.constant(limit, np.float64) for limit in (-card.clip, card.clip))
            x = graph.add("Clip", x, *limits)
        x = graph.cast(x, _FLOAT)
    for number, layer in enumerate(policy.layers):
        if number:
            x = _ACTIVATIONS[card.activation](graph, x)
        x = graph.add("Gemm", x, *map(graph.constant, layer), transB=1)
    if card.end == "tanh":
        low = np.array(card.low)
        x = graph.add("Add", graph.add("Tanh", x), graph.constant(1.0))
        half_width = graph.constant((np.array(card.high) - low) / 2, np.float64)
        x = graph.add("Mul", graph.cast(x, _DOUBLE), half_width)
        x = graph.cast(graph.add("Add", x, graph.constant(low, np.float64)), _FLOAT)
    least, most = map(graph.constant, mlp.float32_bounds(card))
    graph.add("Min", graph.add("Max", x, least), most, result=OUTPUT)
    return graph.model(card.num_observations, len(card.low))


def with_card(content: bytes, card: mlp.Card) -> bytes:
    """A model with a card; it must not have one.

    Joined messages are one message, so the rest of the model is not read.
    """
    entry = _message((1, mlp.CARD_KEY), (2, card.as_text()))
    return content + _message((_CARDS, entry))


def checked(content: bytes) -> str:
    """The text of the card in a model that only does arithmetic.

    Raises:
      ValueError: the model has no card, does more, or is no model.
    """
    graphs, cards = 0, []
    for number, value in _fields(content, _OF_MODEL, "model"):
        if number == _GRAPH:
            graphs += 1
            _check_graph(value)
        elif number == _OPERATOR_SETS:
            for kind, part in _fields(value, (1, 2), "set of operators"):
                if kind == 1:
                    _check_standard(part)
        elif number == _CARDS:
            entry = dict(_fields(value, (1, 2), "entry of metadata"))
            if _text(entry.get(1, b"")) == mlp.CARD_KEY:
                cards.append(_text(entry.get(2, b"")))
    if graphs != 1:
        raise ValueError(_NO_MODEL)
    if len(cards) != 1:
        raise ValueError(f"its metadata has {len(cards)} cards under the name {mlp.CARD_KEY!r}")
    return cards[0]


class _Graph:
    """A graph in the making: nodes with one result each, and constants."""

    def __init__(self) -> None:
        self._nodes: list[bytes] = []
        self._constants: list[bytes] = []

    def constant(self, values: npt.ArrayLike, dtype: type = np.float32) -> str:
        """The name of an array."""
        array = np.asarray(values, dtype)
        name = f"constant_{len(self._constants)}"
        little = array.astype(array.dtype.newbyteorder("<"))
        dims = [(1, size) for size in array.shape]
        about = (2, _TYPES[array.dtype]), (8, name), (9, little.tobytes())
        self._constants.append(_message(*dims, *about))
        return name

    def add(
        self, operator: str, *inputs: str, result: str | None = None, **attributes: float
    ) -> str:
        """The name of an operator's result."""
        result = result or f"value_{len(self._nodes)}"
        given = [(5, _attribute(name, value)) for name, value in attributes.items()]
        self._nodes.append(
            _message(*((1, name) for name in inputs), (2, result), (4, operator), *given)
        )
        return result

    def cast(self, x: str, kind: int) -> str:
        """The name of a value as numbers of another type."""
        return self.add("Cast", x, to=kind)

    def model(self, observations: int, actions: int) -> bytes:
        """The model from float32 (N, observations) to float32 (N, actions)."""
        graph = _message(
            *((1, node) for node in self._nodes),
            (2, "policy"),
            *((5, constant) for constant in self._constants),
            (11, _value_info(INPUT, observations)),
            (12, _value_info(OUTPUT, actions)),
        )
        operators = _message((1, ""), (2, _OPERATORS))
        about = (1, _IR_VERSION), (2, "limberjack"), (_OPERATOR_SETS, operators)
        return _message(*about, (_GRAPH, graph))


_ACTIVATIONS: Mapping[str, Callable[[_Graph, str], str]] = {
    "relu": lambda graph, x: graph.add("Relu", x),
    "relu6": lambda graph, x: graph.add("Clip", x, graph.constant(0.0), graph.constant(6.0)),
    "leaky_relu": lambda graph, x: graph.add("LeakyRelu", x, alpha=mlp.LEAKY_SLOPE),
    "elu": lambda graph, x: graph.add("Elu", x, alpha=1.0),
    "silu": lambda graph, x: graph.add("Mul", x, graph.add("Sigmoid", x)),
    "tanh": lambda graph, x: graph.add("Tanh", x),
}


def _attribute(name: str, value: float) -> bytes:
    if isinstance(value, int):
        return _message((1, name), (3, value), (20, _OF_WHOLE))
    return _message((1, name), (2, value), (20, _OF_FLOAT))


def _value_info(name: str, size: int) -> bytes:
    """An input or an output of float32 numbers, (N, size)."""
    shape = _message((1, _message((2, _ROWS))), (1, _message((1, size))))
    return _message((1, name), (2, _message((1, _message((1, _FLOAT), (2, shape))))))


# Numbers of fields that are accepted, and of those that are read.
_GRAPH, _OPERATOR_SETS, _CARDS = 7, 8, 14
_OF_MODEL = (1, 2, 3, 4, 5, 6, _GRAPH, _OPERATOR_SETS, _CARDS)
_NODE, _CONSTANT = 1, 5
_OF_GRAPH = (_NODE, 2, _CONSTANT, 10, 11, 12, 13, 16)  # and names, documentation, inputs, outputs
_OPERATOR, _ATTRIBUTE, _DOMAIN = 4, 5, 7
_OF_NODE = (1, 2, 3, _OPERATOR, _ATTRIBUTE, 6, _DOMAIN, 9)
_TENSOR, _TENSORS = 5, 10
_OF_ATTRIBUTE = (1, 2, 3, 4, _TENSOR, 7, 8, 9, _TENSORS, 13, 20)  # not graphs, nor types
_PLACE = 14  # of a constant's numbers: 0 in the model, else in another file
_OF_CONSTANT = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, _PLACE, 16)

_REFUSED = {  # names of some of the others
    ("model", 20): "a training",
    ("model", 25): "functions",
    ("graph", 15): "sparse constants",
    ("attribute", 6): "a branch or a loop",
    ("attribute", 11): "branches",
    ("constant", 13): "numbers in another file",
}
_NO_MODEL = "it is cut off, or not in the format ONNX"

_STANDARD = ("", "ai.onnx")  # names of the set of operators that the format describes
_RANDOM = (
    *("Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike"),
    *("RandomUniform", "RandomUniformLike"),
)


def _check_graph(content: bytes) -> None:
    """Raises ValueError if a graph does more than arithmetic on numbers in it."""
    for number, value in _fields(content, _OF_GRAPH, "graph"):
        if number == _NODE:
            _check_node(value)
        elif number == _CONSTANT:
            _check_constant(value)


def _check_node(content: bytes) -> None:
    for number, value in _fields(content, _OF_NODE, "node"):
        if number == _DOMAIN:
            _check_standard(value)
        elif number == _OPERATOR and _text(value) in _RANDOM:
            raise ValueError(f"it draws random numbers, with {_text(value)}")
        elif number == _ATTRIBUTE:
            for kind, part in _fields(value, _OF_ATTRIBUTE, "attribute"):
                if kind in (_TENSOR, _TENSORS):
                    _check_constant(part)


def _check_constant(content: bytes) -> None:
    for number, value in _fields(content, _OF_CONSTANT, "constant"):
        if number == _PLACE and value != b"\0":
            raise ValueError("it has numbers in another file, which no policy needs")


def _check_standard(domain: bytes) -> None:
    if _text(domain) not in _STANDARD:
        raise ValueError(f"it has operators of {_text(domain)[:80]!r}; expected standard ones")


def _text(value: bytes) -> str:
    return value.decode("utf-8")


def _message(*fields: _Field) -> bytes:
    """A message of fields, each a number and a value."""
    return b"".join(_encoded(number, value) for number, value in fields)


def _encoded(number: int, value: _Value) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3 | _WHOLE) + _varint(value)
    if isinstance(value, float):
        return _varint(number << 3 | _FOUR_BYTES) + struct.pack("<f", value)
    content = value.encode("utf-8") if isinstance(value, str) else value
    return _varint(number << 3 | _WITH_LENGTH) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    """A number of at least 0, in groups of 7 bits, the lowest first."""
    groups = bytearray()
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*groups, value])


# Kinds of values, by the lowest three bits of a field's key.
_WHOLE, _EIGHT_BYTES, _WITH_LENGTH, _FOUR_BYTES = 0, 1, 2, 5
_SIZES = {_EIGHT_BYTES: 8, _FOUR_BYTES: 4}
_LONGEST_VARINT = 10  # bytes


def _fields(content: bytes, expected: Sequence[int], what: str) -> Iterator[tuple[int, bytes]]:
    """The numbers and the contents of a message's fields; raises ValueError for unexpected ones.

    The content of a whole number is its bytes as they are in the message.
    """
    at = 0
    while at < len(content):
        key, start = _read_varint(content, at)
        number, kind = key >> 3, key & 7
        if number not in expected:
            name = _REFUSED.get((what, number), f"the field {number} of a {what}")
            raise ValueError(f"it has {name}, which no policy needs")
        if kind == _WHOLE:
            _, at = _read_varint(content, start)
        elif kind == _WITH_LENGTH:
            length, start = _read_varint(content, start)
            at = start + length
        elif kind in _SIZES:
            at = start + _SIZES[kind]
        else:
            raise ValueError(_NO_MODEL)
        if at > len(content):
            raise ValueError(_NO_MODEL)
        yield number, content[start:at]


def _read_varint(content: bytes, at: int) -> tuple[int, int]:
    """The number at a place, and the place after it."""
    value = 0
    for index, byte in enumerate(content[at : at + _LONGEST_VARINT]):
        value |= (byte & 0x7F) << 7 * index
        if byte < 0x80:
            return value, at + index + 1
    raise ValueError(_NO_MODEL)
