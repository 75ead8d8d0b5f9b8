"""Networks in files: a `.safetensors` file with a card, and a forward pass that needs NumPy alone.

    card = mlp.Card(
        layout=(("angle", (2,)), ("speed", (1,))),    # the flat observation, in its order
        low=(-1.0,),
        high=(1.0,),
        activation="relu",
        end="tanh",
        action_repeat=2,
    )
    mlp.save("swing.safetensors", [(weight, bias), (last_weight, last_bias)], card)

    policy = mlp.load("swing.safetensors")
    action = policy.actions(flat_observation)         # (..., 3) -> (..., 1), float32
    actions = policy.act_batch({"angle": angles, "speed": speeds})

The file is one of the format safetensors: float32 tensors `layers.0.weight` of (outputs, inputs)
and `layers.0.bias` of (outputs,), `layers.1.weight` and so on; the card is JSON under the name
`limberjack` in its header. Loading one runs no code. Everything in it is checked, so that a file
from anyone is either a policy or a `PolicyError`.

The forward pass: the flat observation as float32; where the card has `mean` and `scale`, the
observation minus the mean, divided by the scale, clipped to `clip` on both sides; the layers, with
the activation after each but the last; and the end, which is "tanh", stretched to the action's
bounds, or "none", clipped to them.

Batch normalisation that acts without a batch's statistics is linear, and has no layer of its own:
`folded` merges it into the layer that follows it. In the actors of CrossQ, of SBX and of
sb3-contrib, each one precedes a layer; `affine` has its gain and its offset.

    layer = mlp.folded(layer, *mlp.affine(mean, var, epsilon, scale, bias))

Layer normalisation and recurrence have no form here; `policies.onnx` plays networks of any form.

It is one idea, and long: a card says how the layers beside it are used, and most of the code checks
that a file from anyone has both.
"""

import contextlib
import dataclasses
import functools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from limberjack.policies.entries import entry_of, shown
from limberjack.policies.kinds import PolicyError
from limberjack.utils.files import open_regular, write_whole
from limberjack.utils.turns import Turn
from limberjack.worlds import OPTIONS, World

__all__ = [
    "ACTIVATIONS",
    "CARD_KEY",
    "ENDS",
    "LEAKY_SLOPE",
    "MOST_REPEAT",
    "Card",
    "Layer",
    "Layout",
    "Mlp",
    "Scores",
    "affine",
    "beginning",
    "flattened",
    "float32_bounds",
    "folded",
    "load",
    "one_thread",
    "parse",
    "read",
    "save",
]

# A weight of (outputs, inputs) and a bias of (outputs,).
Layer = tuple[npt.ArrayLike, npt.ArrayLike]
# Names and shapes of the observations, in the order of the flat one.
Layout = tuple[tuple[str, tuple[int, ...]], ...]

_FORMAT = 1
CARD_KEY = "limberjack"  # of the card in the header
# Limits for files from anyone. The largest policy that is bundled has 83 kB.
_MOST_BYTES = 2**28
_MOST_HEADER = 2**21
_MOST_LAYERS = 64
_MOST_NUMBERS = 2**20  # in an observation or an action
_MOST_AXES = 32  # of an observation
_LONGEST_TEXT = 200  # characters of all texts but the command
MOST_REPEAT = 1000  # control steps per action
_LONGEST_QUOTE = 300  # characters of an error of another package
LEAKY_SLOPE = 0.01  # of PyTorch's and JAX's leaky_relu
_LENGTH_NBYTES = 8  # of the header's length, at the beginning of the file


def _silu(x: np.ndarray) -> np.ndarray:
    # x * sigmoid(x), without the overflow of exp.
    return x * (np.float32(0.5) * (np.tanh(x * np.float32(0.5)) + np.float32(1)))


ACTIVATIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, np.float32(0)),
    "relu6": lambda x: np.clip(x, np.float32(0), np.float32(6)),
    "leaky_relu": lambda x: np.where(x > 0, x, np.float32(LEAKY_SLOPE) * x),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, np.float32(0)))),
    "silu": _silu,
    "tanh": np.tanh,
}
ENDS = ("tanh", "none")


@dataclasses.dataclass(frozen=True)
class Scores:
    """Returns of the policy on seeds that training has not seen.

    Attributes:
      mean: over the seeds' first episodes, in control steps' rewards.
      interval: the 95 % interval of the mean.
      seeds: the first one, and the one after the last.
    """

    mean: float
    interval: tuple[float, float]
    seeds: tuple[int, int]


@dataclasses.dataclass(frozen=True)
class Card:
    """The facts about a policy that its file has besides the weights.

    Attributes:
      layout: names and shapes of the observations, in the order of the flat one; a single name
        'observations' fits any task whose flat observation has that size.
      low, high: bounds of the actions, one number for each.
      activation: after each layer but the last; see ACTIVATIONS.
      end: 'tanh', stretched to the bounds, or 'none', clipped to them.
      action_repeat: control steps per action, in training and wherever the policy is played.
      domain, task: that it was trained on; empty if that is not known.
      mean, scale: by which flat observations are normalised; None if they are not.
      clip: largest normalised observation; None without a limit.
      sizes: of the observation, the hidden layers and the action; `save` fills them in.
      algorithm: such as 'CrossQ'.
      command: that trained it.
      seeds: of the training.
      steps: control steps of the training; None if that is not known.
      versions: of packages by name: limberjack, mujoco, numpy.
      fingerprint: of the task's model (`limberjack.mujoco.fingerprint`), as it is before the first
        reset of the environment with seed 0; empty if that is not known.
      licence: of the weights; empty if there is no statement.
      scores: returns on seeds that training has not seen; None if that is not known.
      world: of the training, such as its faults (`limberjack.worlds`); None for the task's own.
    """

    layout: Layout
    low: tuple[float, ...]
    high: tuple[float, ...]
    activation: str = "relu"
    end: str = "tanh"
    action_repeat: int = 1
    domain: str = ""
    task: str = ""
    mean: tuple[float, ...] | None = None
    scale: tuple[float, ...] | None = None
    clip: float | None = None
    sizes: tuple[int, ...] = ()
    algorithm: str = ""
    command: str = ""
    seeds: tuple[int, ...] = ()
    steps: int | None = None
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    fingerprint: str = ""
    licence: str = ""
    scores: Scores | None = None
    world: World | None = None

    @property
    def title(self) -> str:
        """The task, as 'walker walk'; empty if it is not known."""
        return f"{self.domain} {self.task}".strip()

    @property
    def num_observations(self) -> int:
        """Numbers in the flat observation."""
        return sum(math.prod(shape) for _, shape in self.layout)

    def as_json(self) -> dict[str, object]:
        """The card as values of JSON."""
        content = {"format": _FORMAT, **dataclasses.asdict(self)}
        # Without an entry for the task's own world, as before there were others.
        return {name: value for name, value in content.items() if name != "world" or value}

    def as_text(self) -> str:
        """The card as one line of JSON; equal cards give equal texts."""
        return json.dumps(self.as_json(), sort_keys=True, separators=(",", ":"))

    @classmethod
    def of_text(cls, text: str | bytes) -> "Card":
        """The card that `as_text` gave, each entry checked.

        Raises:
          ValueError: it is none; the message names the entry.
        """
        return cls.of_json(_parsed("its card", text))

    @classmethod
    def of_json(cls, content: object) -> "Card":
        """The card that `as_json` gave, each entry checked.

        Raises:
          ValueError: it is none; the message names the entry.
        """
        if not isinstance(content, dict):
            raise ValueError("its card is not an object of JSON")
        found = content.get("format")
        if type(found) is not int or found != _FORMAT:
            raise ValueError(
                f"its card has format {shown(found)}; expected {_FORMAT}: a newer Limberjack may "
                "read it"
            )
        given = {name: value for name, value in content.items() if name != "format"}
        try:
            card = entry_of(cls, given)
        except ValueError as error:
            raise ValueError(f"its {error}") from None
        _check(card)
        return card


_turn = Turn()  # the number of threads belongs to the process


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """A context in which matrix products are computed by the calling thread alone.

    NumPy's library of linear algebra (BLAS) divides a product among as many threads as there are
    cores, and each division rounds in its own way. After a product its threads wait for the next
    one without giving up their cores, on which the rows of a batch could be stepped: with a
    policy's network, two cores then step a walker hardly faster than one.

    Only one thread can be in it; others wait. Libraries that cannot be limited stay as they are.
    """
    with _turn.lock, _libraries().limit(limits=1):
        yield


@functools.cache
def _libraries() -> ThreadpoolController:
    """Those of linear algebra that this process has loaded."""
    return ThreadpoolController().select(user_api="blas")


class Mlp:
    """A policy: a network and its card.

    Attributes:
      card: see `Card`.
      layers: float32 weights of (outputs, inputs) and biases of (outputs,); not to be written to.
    """

    def __init__(self, layers: Sequence[Layer], card: Card) -> None:
        """Takes at least one layer, and a card, whose `sizes` become those of the layers.

        Raises:
          ValueError: layers and card do not fit each other, or a number is not finite.
        """
        self.layers = tuple((_float32(weight), _float32(bias)) for weight, bias in layers)
        sizes = _sizes(self.layers)
        self.card = card = Card.of_json(dataclasses.replace(card, sizes=sizes).as_json())
        self._least, self._most = float32_bounds(card)
        self._low = np.array(card.low)
        self._half_width = np.array(card.high) / 2 - self._low / 2  # the difference may overflow
        self._norm = None
        if card.mean is not None and card.scale is not None:
            self._norm = np.array(card.mean), np.array(card.scale)

    def actions(self, observation: npt.ArrayLike) -> np.ndarray:
        """The actions at flat observations: (..., observations) -> (..., actions), float32.

        A matrix product of another number of rows may round differently, but not one on another
        number of cores. What must be equal bit for bit needs equal shapes; `policies.find` always
        shows 64 rows.

        Raises:
          ValueError: the observation has another size.
        """
        x = np.asarray(observation, np.float32)
        if x.shape[-1:] != (self.card.num_observations,):
            raise ValueError(
                f"observation has shape {x.shape}; expected (..., {self.card.num_observations})"
            )
        activation = ACTIVATIONS[self.card.activation]
        # Weights from anyone may overflow; an action that is no number is refused where it is used.
        with one_thread(), np.errstate(over="ignore", invalid="ignore"):
            x = self._normalised(x)
            for weight, bias in self.layers[:-1]:
                x = activation(x @ weight.T + bias)
            weight, bias = self.layers[-1]
            return self._within_bounds(x @ weight.T + bias)

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions, (N, actions), at observations of (N, ...) by name.

        Those that the card does not name are ignored.
        """
        return self.actions(flattened(self.card.layout, observations))

    def with_layout(self, layout: Layout) -> "Mlp":
        """The same network for an environment with these names of its observations."""
        return Mlp(self.layers, dataclasses.replace(self.card, layout=layout))

    def _normalised(self, x: np.ndarray) -> np.ndarray:
        if self._norm is None:
            return x
        mean, scale = self._norm
        x = (x - mean) / scale  # in float64, as Stable-Baselines3 does
        if self.card.clip is not None:
            x = np.clip(x, -self.card.clip, self.card.clip)
        return x.astype(np.float32)

    def _within_bounds(self, x: np.ndarray) -> np.ndarray:
        if self.card.end == "tanh":
            x = (self._low + (np.tanh(x) + 1.0) * self._half_width).astype(np.float32)
        return np.clip(x, self._least, self._most)


def flattened(layout: Layout, observations: Mapping[str, np.ndarray]) -> np.ndarray:
    """Observations of (N, ...) by name in the order of a layout: (N, size), float32."""
    given = (np.asarray(observations[name]) for name, _ in layout)
    parts = [one.reshape(len(one), -1) for one in given]
    return np.concatenate(parts, axis=1, dtype=np.float32, casting="unsafe")


def float32_bounds(card: Card) -> tuple[np.ndarray, np.ndarray]:
    """The bounds of the actions, rounded inward where float32 cannot represent them."""
    low, high = np.array(card.low), np.array(card.high)
    with np.errstate(over="ignore"):  # a bound of a file may be beyond float32
        least, most = low.astype(np.float32), high.astype(np.float32)
    least = np.where(least < low, np.nextafter(least, np.float32(np.inf)), least)
    return least, np.where(most > high, np.nextafter(most, np.float32(-np.inf)), most)


def folded(layer: Layer, gain: npt.ArrayLike, offset: npt.ArrayLike) -> Layer:
    """The layer that does for x what `layer` does for x * gain + offset; see the docstring above.

    Args:
      layer: a weight of (outputs, inputs) and a bias of (outputs,).
      gain, offset: (inputs,).
    """
    weight, bias = (np.asarray(part, np.float64) for part in layer)
    return weight * np.asarray(gain, np.float64), bias + weight @ np.asarray(offset, np.float64)


def affine(
    mean: npt.ArrayLike,
    var: npt.ArrayLike,
    epsilon: float,
    scale: npt.ArrayLike = 1.0,
    bias: npt.ArrayLike = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """The gain and the offset of (x - mean) / sqrt(var + epsilon) * scale + bias."""
    gain = np.asarray(scale, np.float64) / np.sqrt(np.asarray(var, np.float64) + epsilon)
    return gain, np.asarray(bias, np.float64) - np.asarray(mean, np.float64) * gain


def save(path: Path | str, layers: Sequence[Layer], card: Card) -> None:
    """Writes a policy, in the place of a file of that name.

    Equal policies give equal bytes.

    Args:
      path: of the file, which by custom ends in .safetensors.
      layers, card: as for `Mlp`.

    Raises:
      ValueError: layers and card do not fit each other, or a number is not finite.
      OSError: the file cannot be written.
    """
    from safetensors import numpy as tensors_of

    policy = Mlp(layers, card)
    pairs = enumerate(policy.layers)
    tensors = {_name(i, j): part for i, pair in pairs for j, part in enumerate(pair)}
    content = tensors_of.save(tensors, {CARD_KEY: policy.card.as_text()})
    write_whole(Path(path), content)


def load(path: Path | str) -> Mlp:
    """The policy in a file that `save` has written.

    Raises:
      PolicyError: there is none; the message is one line and names the file.
    """
    return parse(read(Path(path)), str(path))


def read(path: Path) -> bytes:
    """The content of the file at `path`, unless that is too large for a policy.

    Raises:
      PolicyError: it cannot be read.
    """
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size > _MOST_BYTES:
                raise ValueError(f"{path} has more than {_MOST_BYTES} bytes; expected a policy")
            return file.read(_MOST_BYTES)
    except (OSError, ValueError) as error:
        raise PolicyError(str(error)) from error


def parse(content: bytes, title: str) -> Mlp:
    """The policy in the content of a file.

    Args:
      content: of the file.
      title: of the file, for messages.

    Raises:
      PolicyError: it is none.
    """
    import safetensors

    try:
        card = Card.of_text(_card_of(content))
        entries = safetensors.deserialize(content)
        policy = Mlp(_layers({name: _array(entry) for name, entry in entries}), card)
        if policy.card != card:
            raise ValueError(
                f"its card has sizes {shown(card.sizes)}, and its layers {policy.card.sizes}"
            )
    except (ValueError, safetensors.SafetensorError) as error:
        raise PolicyError(
            f"{title} cannot be played: {beginning(error)}; expected a file that "
            "`limberjack train`, `limberjack export` or limberjack.policies.mlp.save wrote"
        ) from error
    return policy


def beginning(error: Exception) -> str:
    """The beginning of an error that may quote a file from anyone, on one line."""
    return " ".join(str(error).split())[:_LONGEST_QUOTE]


def _card_of(content: bytes) -> str:
    """The text of the card in the header of a file; raises ValueError if there is none."""
    length = int.from_bytes(content[:_LENGTH_NBYTES], "little")
    if len(content) < _LENGTH_NBYTES or length > min(len(content) - _LENGTH_NBYTES, _MOST_HEADER):
        raise ValueError("it is cut off, or not in the format safetensors")
    header = _parsed("its header", content[_LENGTH_NBYTES : _LENGTH_NBYTES + length])
    metadata = header.get("__metadata__") if isinstance(header, dict) else None
    text = metadata.get(CARD_KEY) if isinstance(metadata, dict) else None
    if not isinstance(text, str):
        raise ValueError(f"its header has no card under the name {CARD_KEY!r}")
    return text


def _parsed(what: str, text: str | bytes) -> object:
    """A text of JSON; raises ValueError if it is none."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(f"{what} is nested too deeply") from None
    except ValueError as error:  # no UTF-8, too
        raise ValueError(f"{what} is not JSON ({error})") from None


def _array(entry: Mapping[str, Any]) -> np.ndarray:  # Any: as safetensors declares it
    if entry["dtype"] != "F32":
        raise ValueError(f"it has tensors of type {entry['dtype']}; expected F32")
    array = np.frombuffer(entry["data"], np.dtype("<f4")).reshape(entry["shape"])
    return array.astype(np.float32)


def _layers(tensors: dict[str, np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The tensors as layers; raises ValueError if one is missing or unknown."""
    count = len(tensors) // 2
    expected = {_name(i, j) for i in range(count) for j in range(2)}
    if tensors.keys() != expected or not expected:
        other = sorted(tensors.keys() ^ expected) or ["layers.0.weight"]
        raise ValueError(f"the tensor {shown(other[0])} is missing or unknown")
    return [(tensors[_name(i, 0)], tensors[_name(i, 1)]) for i in range(count)]


def _name(layer: int, part: int) -> str:
    return f"layers.{layer}.{('weight', 'bias')[part]}"


def _sizes(layers: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[int, ...]:
    """The sizes of inputs and of all layers; raises ValueError if layers do not fit each other."""
    if not 1 <= len(layers) <= _MOST_LAYERS:
        raise ValueError(f"it has {len(layers)} layers; expected 1 to {_MOST_LAYERS}")
    sizes = [layers[0][0].shape[-1] if layers[0][0].ndim else 0]
    for number, (weight, bias) in enumerate(layers):
        outputs = bias.size
        if weight.shape != (outputs, sizes[-1]) or bias.shape != (outputs,) or weight.size == 0:
            raise ValueError(
                f"layer {number} has a weight of shape {weight.shape} and a bias of shape "
                f"{bias.shape}; expected (outputs, {sizes[-1]}) and (outputs,)"
            )
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ValueError(f"layer {number} has numbers that are not finite")
        sizes.append(outputs)
    return tuple(sizes)


def _float32(part: npt.ArrayLike) -> np.ndarray:
    with np.errstate(over="ignore"):  # infinite numbers are refused later
        return np.ascontiguousarray(part, np.float32)


def _check(card: Card) -> None:
    """Raises ValueError unless the entries of a card fit each other."""
    size = card.num_observations
    names = [name for name, _ in card.layout]
    for name, value in vars(card).items():
        if isinstance(value, str) and name != "command" and len(value) > _LONGEST_TEXT:
            raise ValueError(
                f"its {name} is {shown(value)}; expected at most {_LONGEST_TEXT} characters"
            )
    if any(len(shape) > _MOST_AXES for _, shape in card.layout):
        raise ValueError(f"its layout is {shown(card.layout)}; expected at most {_MOST_AXES} axes")
    if not 1 <= size <= _MOST_NUMBERS or len(set(names)) < len(names):
        raise ValueError(f"its layout has {shown(size)} numbers, with the names {shown(names)}")
    if card.sizes[:1] != (size,) or card.sizes[-1:] != (len(card.low),):
        raise ValueError(
            f"its layers have sizes {shown(card.sizes)}, with {size} observations and "
            f"{len(card.low)} actions"
        )
    if len(card.low) != len(card.high) or any(map(float.__gt__, card.low, card.high)):
        raise ValueError(f"its actions have bounds {shown(card.low)} and {shown(card.high)}")
    if card.activation not in ACTIVATIONS:
        raise ValueError(
            f"its activation is {shown(card.activation)}; expected one of {', '.join(ACTIVATIONS)}"
        )
    if card.end not in ENDS:
        raise ValueError(f"its end is {shown(card.end)}; expected one of {', '.join(ENDS)}")
    if not 1 <= card.action_repeat <= MOST_REPEAT:
        raise ValueError(f"its action_repeat is {card.action_repeat}; expected 1 to {MOST_REPEAT}")
    if (card.mean is None) != (card.scale is None):
        raise ValueError("it has one of mean and scale; expected both or neither")
    for name, values in (("mean", card.mean), ("scale", card.scale)):
        if values is not None and len(values) != size:
            raise ValueError(f"its {name} has {len(values)} numbers; expected {size}")
    if min(card.scale or (1.0,)) <= 0:
        raise ValueError("its scale has numbers that are not positive")
    if card.clip is not None and (card.clip <= 0 or card.mean is None):
        raise ValueError(f"its clip is {card.clip}; expected a positive number, with a mean")
    if card.world is not None and (not card.world or not card.world.keys() <= OPTIONS):
        raise ValueError(f"its world is {shown(card.world)}; expected some of {sorted(OPTIONS)}")
