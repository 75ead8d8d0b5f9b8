"""Models in the format ONNX: one made of a network, a card added to one, and one checked.

    content = with_card(model_of(policy), policy.card)
    text = checked(content)     # that of the card

`checked` walks through every part of a model, and accepts only what a policy needs: one graph of
standard operators without branches, loops, functions, random numbers, and files beside it. The
numbers themselves are left to the runtime; see `policies.onnx`.

No other file imports the package onnx.
"""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from limberjack.policies import mlp
from limberjack.utils.requirements import missing_extra

try:
    import onnx
    from google.protobuf.message import DecodeError, Message
    from google.protobuf.unknown_fields import UnknownFieldSet
    from onnx import helper, numpy_helper
except ImportError as error:
    raise missing_extra("onnx") from error

__all__ = ["INPUT", "OUTPUT", "Graph", "checked", "model_of", "with_card"]

INPUT, OUTPUT = "observation", "action"  # names in the models that are made here

_IR_VERSION = 8  # of the format, and of its operators: both of 2022, which all runtimes read
_OPERATORS = 17
_ROWS = "N"  # the name of the first axis, whose size is not fixed
_FLOAT, _DOUBLE = onnx.TensorProto.FLOAT, onnx.TensorProto.DOUBLE


def model_of(policy: mlp.Mlp) -> bytes:
    """A model that acts as `policy.actions` does on (N, observations) float32.

    It rounds as the network does, save that the runtime may sum in another order.
    """
    card, graph = policy.card, Graph()
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
    """A model with a card; it must not have one. Raises ValueError if it is no model."""
    model = _parsed(content)
    model.metadata_props.add(key=mlp.CARD_KEY, value=card.as_text())
    return model.SerializeToString(deterministic=True)


def checked(content: bytes) -> str:
    """The text of the card in a model that only does arithmetic.

    Raises:
      ValueError: the model has no card, does more, or is no model.
    """
    model, graphs = _parsed(content), 0
    for message in _messages(model):
        _check(message)
        graphs += isinstance(message, onnx.GraphProto)
    if graphs > 1:
        raise ValueError("it has a branch or a loop, which no policy needs")
    cards = [entry.value for entry in model.metadata_props if entry.key == mlp.CARD_KEY]
    if len(cards) != 1:
        raise ValueError(f"its metadata has {len(cards)} cards under the name {mlp.CARD_KEY!r}")
    return cards[0]


class Graph:
    """A graph in the making: nodes with one result each, and constants."""

    def __init__(self) -> None:
        self._nodes: list[onnx.NodeProto] = []
        self._constants: list[onnx.TensorProto] = []

    def constant(self, values: npt.ArrayLike, dtype: type = np.float32) -> str:
        """The name of an array."""
        name = f"constant_{len(self._constants)}"
        self._constants.append(numpy_helper.from_array(np.asarray(values, dtype), name))
        return name

    def add(
        self, operator: str, *inputs: str, result: str | None = None, **attributes: float
    ) -> str:
        """The name of an operator's result."""
        result = result or f"value_{len(self._nodes)}"
        node = helper.make_node(operator, inputs, [result])
        node.attribute.extend(helper.make_attribute(*item) for item in attributes.items())
        self._nodes.append(node)
        return result

    def cast(self, x: str, kind: int) -> str:
        """The name of a value as numbers of another type."""
        return self.add("Cast", x, to=kind)

    def model(self, observations: int, actions: int) -> bytes:
        """The model from float32 (N, observations) to float32 (N, actions)."""
        given, returned = (
            helper.make_tensor_value_info(name, _FLOAT, [_ROWS, size])
            for name, size in ((INPUT, observations), (OUTPUT, actions))
        )
        graph = helper.make_graph(self._nodes, "policy", [given], [returned], self._constants)
        made = helper.make_model(
            graph,
            producer_name="limberjack",
            ir_version=_IR_VERSION,
            opset_imports=[helper.make_opsetid("", _OPERATORS)],
        )
        return made.SerializeToString(deterministic=True)


_ACTIVATIONS: Mapping[str, Callable[[Graph, str], str]] = {
    "relu": lambda graph, x: graph.add("Relu", x),
    "relu6": lambda graph, x: graph.add("Clip", x, graph.constant(0.0), graph.constant(6.0)),
    "leaky_relu": lambda graph, x: graph.add("LeakyRelu", x, alpha=mlp.LEAKY_SLOPE),
    "elu": lambda graph, x: graph.add("Elu", x, alpha=1.0),
    "silu": lambda graph, x: graph.add("Mul", x, graph.add("Sigmoid", x)),
    "tanh": lambda graph, x: graph.add("Tanh", x),
}

_STANDARD = ("", "ai.onnx")  # names of the set of operators that the format describes
_RANDOM = (
    *("Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike"),
    *("RandomUniform", "RandomUniformLike"),
)
_REFUSED: Mapping[type[Message], str] = {
    onnx.FunctionProto: "functions",
    onnx.TrainingInfoProto: "a training",
    onnx.SparseTensorProto: "sparse constants",
}
_NO_MODEL = "it is cut off, or not in the format ONNX"


def _parsed(content: bytes) -> onnx.ModelProto:
    """The model in a content; raises ValueError if there is none."""
    model = onnx.ModelProto()
    try:
        model.ParseFromString(content)
    except DecodeError as error:
        raise ValueError(_NO_MODEL) from error
    if not model.HasField("graph"):
        raise ValueError(_NO_MODEL)
    return model


def _messages(message: Message) -> Iterator[Message]:
    """A message and all messages in it."""
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in [value] if isinstance(value, Message) else value:
                yield from _messages(part)


def _check(message: Message) -> None:
    """Raises ValueError if a part of a model does more than arithmetic."""
    if len(UnknownFieldSet(message)):
        raise ValueError("it has fields that the format does not have, which no policy needs")
    refused = _REFUSED.get(type(message))
    if refused is not None:
        raise ValueError(f"it has {refused}, which no policy needs")
    if isinstance(message, onnx.TensorProto):
        is_inside = message.data_location == onnx.TensorProto.DEFAULT
        if not is_inside or message.external_data:
            raise ValueError("it has numbers in another file, which no policy needs")
    if isinstance(message, onnx.NodeProto) and message.op_type in _RANDOM:
        raise ValueError(f"it draws random numbers, with {message.op_type}")
    has_operators = isinstance(message, onnx.NodeProto | onnx.OperatorSetIdProto)
    if has_operators and message.domain not in _STANDARD:
        raise ValueError(f"it has operators of {message.domain[:80]!r}; expected standard ones")
