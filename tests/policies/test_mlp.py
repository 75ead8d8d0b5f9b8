"""The format of policy files, on networks with drawn weights."""

import dataclasses
import itertools
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors import numpy as safetensors_numpy
from threadpoolctl import ThreadpoolController

from limberjack.policies import PolicyError, mlp

from ..programs import run

_LAYOUT = (("orientations", (3, 2)), ("height", ()), ("speed", (2,)))
_CARD = mlp.Card(
    layout=_LAYOUT,
    low=(-1.0, -0.1, 0.0),
    high=(1.0, 0.3, 2.0),
    activation="relu",
    end="tanh",
    action_repeat=2,
    domain="walker",
    task="walk",
    algorithm="CrossQ",
    command="limberjack train walker walk --out walk",
    seeds=(3,),
    steps=400_000,
    versions={"limberjack": "0.1", "mujoco": "4.0.0"},
    fingerprint="0" * 64,
    licence="Apache-2.0",
    scores=mlp.Scores(949.5, (940.0, 955.25), (1000, 1100)),
)


def _drawn(*sizes: int, seed: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Layers of these sizes."""
    stream = np.random.RandomState(seed)
    pairs = itertools.pairwise(sizes)
    return [(stream.randn(m, n) / np.sqrt(n), stream.randn(m)) for n, m in pairs]


_LAYERS = _drawn(9, 16, 8, 3)


def _saved(path: Path, card: mlp.Card = _CARD) -> bytes:
    mlp.save(path, _LAYERS, card)
    return path.read_bytes()


def test_a_saved_policy_is_loaded_with_its_card_and_weights(tmp_path: Path) -> None:
    path = tmp_path / "walk.safetensors"
    mlp.save(path, _LAYERS, _CARD)
    policy = mlp.load(path)
    assert policy.card == dataclasses.replace(_CARD, sizes=(9, 16, 8, 3))
    for expected, found in zip(_LAYERS, policy.layers, strict=True):
        for one, other in zip(expected, found, strict=True):
            np.testing.assert_array_equal(one.astype(np.float32), other)
            assert other.dtype == np.float32


def test_a_card_has_a_world_only_where_it_is_not_the_tasks_own(tmp_path: Path) -> None:
    assert "world" not in _CARD.as_json()
    card = dataclasses.replace(_CARD, world={"faults": {"delay": {"actions": 3}}})
    assert b"actions" in _saved(tmp_path / "faulty", card)
    assert mlp.load(tmp_path / "faulty").card.world == card.world


def test_equal_policies_give_equal_bytes(tmp_path: Path) -> None:
    contents = {_saved(tmp_path / f"{number}.safetensors") for number in range(3)}
    assert len(contents) == 1
    again = mlp.parse(contents.copy().pop(), "a policy")
    mlp.save(tmp_path / "again", again.layers, again.card)
    assert (tmp_path / "again").read_bytes() in contents


# In float64, written out.
_EXPECTED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.where(x > 0, x, 0),
    "relu6": lambda x: np.where(x > 6, 6, np.where(x > 0, x, 0)),
    "leaky_relu": lambda x: np.where(x > 0, x, 0.01 * x),
    "elu": lambda x: np.where(x > 0, x, np.exp(np.minimum(x, 0)) - 1),
    "silu": lambda x: x / (1 + np.exp(-np.maximum(x, -700))),
    "tanh": np.tanh,
}


@pytest.mark.parametrize("name", mlp.ACTIVATIONS)
def test_each_activation_is_its_formula_and_never_overflows(name: str) -> None:
    x = np.concatenate([np.linspace(-12, 12, 97), [-3e4, 3e4, -1e30, 1e30, 0.0]])
    with np.errstate(all="raise", under="ignore"):
        found = mlp.ACTIVATIONS[name](x.astype(np.float32))
    assert found.dtype == np.float32
    # The formula is computed in float64, the activation in float32: 6e-8 each for an exponential, a
    # sum and a product.
    np.testing.assert_allclose(found, _EXPECTED[name](x), rtol=2e-6, atol=2e-6)


@pytest.mark.parametrize("activation", mlp.ACTIVATIONS)
@pytest.mark.parametrize("end", mlp.ENDS)
def test_actions_are_those_of_the_layers_within_the_bounds(
    activation: str, end: str, tmp_path: Path
) -> None:
    card = dataclasses.replace(_CARD, activation=activation, end=end)
    _saved(tmp_path / "p", card)
    policy = mlp.load(tmp_path / "p")
    observation = np.random.RandomState(1).randn(64, 9)
    x = observation
    for weight, bias in _LAYERS[:-1]:
        x = _EXPECTED[activation](x @ weight.T + bias)
    x = x @ _LAYERS[-1][0].T + _LAYERS[-1][1]
    low, high = np.array(card.low), np.array(card.high)
    expected = np.clip(x, low, high) if end == "none" else low + (np.tanh(x) + 1) / 2 * (high - low)
    actions = policy.actions(observation)
    assert actions.dtype == np.float32
    np.testing.assert_allclose(actions, expected, atol=1e-5)  # float32 against float64
    np.testing.assert_allclose(policy.actions(observation[7]), expected[7], atol=1e-5)
    assert policy.actions(observation.reshape(4, 16, 9)).shape == (4, 16, 3)


def test_actions_never_leave_bounds_that_float32_cannot_represent(tmp_path: Path) -> None:
    layers = [(1e6 * weight, bias) for weight, bias in _drawn(9, 3)]
    for end in mlp.ENDS:
        mlp.save(tmp_path / "p", layers, dataclasses.replace(_CARD, end=end))
        actions = mlp.load(tmp_path / "p").actions(np.random.RandomState(1).randn(200, 9))
        exact = actions.astype(np.float64)
        assert (exact >= _CARD.low).all()
        assert (exact <= _CARD.high).all()
        assert np.ptp(actions, axis=0).min() > 0.39


@pytest.mark.parametrize("end", mlp.ENDS)
def test_bounds_as_wide_as_numbers_can_be_are_those_of_any_action(end: str) -> None:
    widest = (sys.float_info.max,) * 3
    card = dataclasses.replace(_CARD, low=tuple(-x for x in widest), high=widest, end=end)
    actions = mlp.Mlp(_LAYERS, card).actions(np.random.RandomState(1).randn(64, 9))
    assert np.isfinite(actions).all()
    assert actions.min() < 0 < actions.max()


def test_observations_are_normalised_and_clipped_as_the_card_says(tmp_path: Path) -> None:
    mean, scale = tuple(np.linspace(-1, 1, 9).tolist()), tuple(np.linspace(0.1, 3, 9).tolist())
    card = dataclasses.replace(_CARD, mean=mean, scale=scale, clip=2.0)
    _saved(tmp_path / "normalised", card)
    _saved(tmp_path / "plain")
    observation = np.random.RandomState(2).randn(64, 9).astype(np.float32)
    normalised = (observation - np.array(mean)) / np.array(scale)
    clipped = np.clip(normalised, -2, 2)
    assert (clipped != normalised).any()
    found = mlp.load(tmp_path / "normalised").actions(observation)
    np.testing.assert_array_equal(found, mlp.load(tmp_path / "plain").actions(clipped))


def test_named_observations_are_joined_in_the_order_of_the_card(tmp_path: Path) -> None:
    _saved(tmp_path / "p")
    policy = mlp.load(tmp_path / "p")
    stream = np.random.RandomState(3)
    named = {
        "speed": stream.randn(64, 2),
        "other": stream.randn(64, 5),
        "orientations": stream.randn(64, 3, 2),
        "height": stream.randn(64),
    }
    flat = np.concatenate(
        [named["orientations"].reshape(64, 6), named["height"][:, None], named["speed"]], axis=1
    )
    np.testing.assert_array_equal(policy.act_batch(named), policy.actions(flat))


def test_an_observation_of_another_size_is_refused(tmp_path: Path) -> None:
    _saved(tmp_path / "p")
    short = {"orientations": np.ones((64, 1)), "height": np.ones(64), "speed": np.ones((64, 2))}
    with pytest.raises(ValueError, match=r"shape \(64, 4\); expected \(\.\.\., 9\)"):
        mlp.load(tmp_path / "p").act_batch(short)  # none is repeated to fill the space of six
    with pytest.raises(ValueError, match=r"shape \(64, 8\); expected \(\.\.\., 9\)"):
        mlp.load(tmp_path / "p").actions(np.zeros((64, 8)))


def test_folding_merges_a_normalisation_into_the_layer_that_follows_it() -> None:
    stream = np.random.RandomState(4)
    mean, var, scale, bias = stream.randn(9), stream.rand(9), stream.randn(9), stream.randn(9)
    x = stream.randn(5, 9)
    normalised = (x - mean) / np.sqrt(var + 1e-3) * scale + bias
    affine = mlp.affine(mean, var, 1e-3, scale, bias)
    weight, offset = (np.asarray(part) for part in mlp.folded(_LAYERS[0], *affine))
    expected = normalised @ _LAYERS[0][0].T + _LAYERS[0][1]
    # The same sums of float64 in another order.
    np.testing.assert_allclose(x @ weight.T + offset, expected, rtol=1e-12, atol=1e-12)


_CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"layout": ()}, "its layout has 0 numbers"),
    ({"layout": (("a", (4,)), ("a", (5,)))}, "its layout has 9 numbers, with the names .'a', 'a'."),
    ({"layout": (("a", (8,)),)}, "sizes .9, 16, 8, 3., with 8 observations and 3 actions"),
    ({"layout": (("a", (2**62,) * 30),)}, "its layout has"),
    ({"layout": (("a", (1,) * 60),)}, "its layout is"),
    ({"layout": (("a", (-9,)),)}, "its layout is"),
    ({"low": (0.0,)}, "with 9 observations and 1 actions"),
    ({"low": (0.0, 0.5, 0.0)}, "its actions have bounds"),
    ({"high": (float("nan"), 1.0, 1.0)}, "its high is .*expected a finite number"),
    ({"high": (float("inf"), 1.0, 1.0)}, "its high is .*expected a finite number"),
    ({"high": (10**400, 1.0, 1.0)}, "its high is"),
    ({"activation": "gelu"}, "its activation is 'gelu'; expected one of relu, relu6"),
    ({"activation": None}, "its activation is None"),
    ({"end": "sigmoid"}, "its end is 'sigmoid'; expected one of tanh, none"),
    ({"action_repeat": 1001}, "its action_repeat is 1001; expected 1 to 1000"),
    ({"action_repeat": 0}, "its action_repeat is 0"),
    ({"action_repeat": True}, "its action_repeat is True"),
    ({"action_repeat": 2.0}, "its action_repeat is 2.0"),
    ({"mean": (0.0,) * 9}, "one of mean and scale"),
    ({"mean": (0.0,) * 8, "scale": (1.0,) * 9}, "its mean has 8 numbers; expected 9"),
    ({"mean": (0.0,) * 9, "scale": (0.0,) * 9}, "its scale has numbers that are not positive"),
    ({"clip": 10.0}, "its clip is 10.0; expected a positive number, with a mean"),
    ({"domain": 3}, "its domain is 3"),
    ({"domain": "w" * 201}, r"its domain is 'www.*\.\.\."),
    ({"command": "x" * 20_000}, r"its command is 'xxx.*\.\.\."),
    ({"steps": -1}, "its steps is -1"),
    ({"seeds": (0.5,)}, r"its seeds is .0\.5"),
    ({"versions": {"mujoco": 4}}, "its versions is"),
    ({"scores": "many"}, "its scores is 'many'"),
    ({"scores": {"mean": 1, "interval": [1], "seeds": [0, 1]}}, "its scores is"),
    ({"world": "faulty"}, "its world is 'faulty'"),
    ({"world": {"falts": {}}}, "its world is {'falts': {}}"),
]


@pytest.mark.parametrize(("changes", "message"), _CHANGES)
def test_a_card_that_does_not_fit_is_refused_as_it_is_saved_and_as_it_is_loaded(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        mlp.save(tmp_path / "p", _LAYERS, dataclasses.replace(_CARD, **changes))
    assert not (tmp_path / "p").exists()
    content = {**mlp.load(_whole(tmp_path)).card.as_json(), **changes}
    with pytest.raises(PolicyError, match=message) as caught:
        mlp.parse(_forged(json.dumps(content)), "forged")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_a_card_with_arrays_says_what_to_give_instead() -> None:
    bounds: Any = np.zeros(3), (np.float32(0),) * 3
    for low, message in zip(bounds, ("a list, such", "a finite number, such"), strict=True):
        with pytest.raises(ValueError, match=f"its low is .*; expected {message} as array.tolist"):
            mlp.Mlp(_LAYERS, dataclasses.replace(_CARD, low=low))
    repeat: Any = np.int64(2)
    with pytest.raises(ValueError, match=r"its action_repeat is .*; .*such as array\.tolist"):
        mlp.Mlp(_LAYERS, dataclasses.replace(_CARD, action_repeat=repeat))


def _whole(directory: Path) -> Path:
    path = directory / "whole.safetensors"
    mlp.save(path, _LAYERS, _CARD)
    return path


def _tensors() -> dict[str, np.ndarray]:
    parts = ("weight", "bias")
    return {
        f"layers.{number}.{name}": part.astype(np.float32)
        for number, layer in enumerate(_LAYERS)
        for name, part in zip(parts, layer, strict=True)
    }


def _forged(card: str | None = None, tensors: dict[str, np.ndarray] | None = None) -> bytes:
    """A file of the format safetensors with this card and these tensors."""
    if card is None:
        sizes = (9, 16, 8, 3)
        card = json.dumps(dataclasses.replace(_CARD, sizes=sizes).as_json())
    return safetensors_numpy.save(_tensors() if tensors is None else tensors, {"limberjack": card})


def _with_header(header: bytes, data: bytes = b"") -> bytes:
    return len(header).to_bytes(8, "little") + header + data


def test_a_forged_file_without_a_fault_is_a_policy() -> None:
    assert mlp.parse(_forged(), "forged").card.task == "walk"


_NAN = np.array([0, np.nan, 0], np.float32)
_BAD_TENSORS: list[tuple[dict[str, np.ndarray | None], str]] = [
    ({"layers.2.bias": _NAN}, "layer 2 has numbers that are not finite"),
    ({"layers.2.bias": _NAN.astype(np.float64)}, "tensors of type F64; expected F32"),
    ({"layers.2.bias": np.zeros(3, np.int8)}, "tensors of type I8; expected F32"),
    ({"layers.2.bias": np.zeros(4, np.float32)}, "layer 2 has a weight of shape"),
    ({"layers.2.bias": np.zeros((3, 1), np.float32)}, "layer 2 has a weight of shape"),
    ({"layers.2.bias": None}, "the tensor 'layers.2.*' is missing or unknown"),
    ({"layers.2.gain": np.zeros(3, np.float32)}, "the tensor 'layers.2.gain' is missing"),
    ({"layers.0.weight": np.zeros((), np.float32)}, "layer 0 has a weight of shape"),
    ({"layers.0.weight": np.zeros((16, 7), np.float32)}, "its layers have sizes .7, 16"),
    ({"layers.1.weight": np.zeros((0, 16), np.float32)}, "layer 1 has a weight of shape"),
]


@pytest.mark.parametrize(("changes", "message"), _BAD_TENSORS)
def test_tensors_that_are_no_layers_are_refused(
    changes: dict[str, np.ndarray | None], message: str
) -> None:
    merged = {**_tensors(), **changes}
    tensors = {name: value for name, value in merged.items() if value is not None}
    with pytest.raises(PolicyError, match=message):
        mlp.parse(_forged(tensors=tensors), "forged")


def test_a_card_with_other_hidden_layers_is_refused() -> None:
    card = dataclasses.replace(_CARD, sizes=(9, 17, 8, 3)).as_json()
    with pytest.raises(PolicyError, match=r"its card has sizes \(9, 17, 8, 3\), and its layers"):
        mlp.parse(_forged(json.dumps(card)), "forged")


_CARD_KEY = b'{"__metadata__":{"limberjack":'
_HOSTILE: dict[str, bytes] = {
    "empty": b"",
    "short": b"\x00\x00\x00",
    "zeros": bytes(4096),
    "a text": b"weights of the walker\n" * 40,
    "a zip file": b"PK\x03\x04" + bytes(200),
    "a pickle": b"\x80\x04\x95\x1d\x00\x00\x00\x00\x00\x00\x00cposix\nsystem\n(S'true'\ntR.",
    "a huge header": (2**63).to_bytes(8, "little") + b"{}",
    "a large header that is there": _with_header(b" " * 2**22),
    "deep header": _with_header(b"[" * 100_000),
    "deep card": _with_header(_CARD_KEY + json.dumps("[" * 100_000).encode() + b"}}"),
    "no object": _with_header(b"[]"),
    "no metadata": _with_header(
        b'{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}', bytes(4)
    ),
    "metadata of another kind": _with_header(b'{"__metadata__":[]}'),
    "a card of another kind": _with_header(b'{"__metadata__":{"limberjack":3}}'),
    "a card that is no JSON": _with_header(_CARD_KEY + b'"{"}}'),
    "a card of a list": _with_header(_CARD_KEY + b'"[]"}}'),
    "a later format": _with_header(_CARD_KEY + b'"{\\"format\\":2}"}}'),
    "a format of another kind": _with_header(_CARD_KEY + b'"{\\"format\\":true}"}}'),
    "no UTF-8": _with_header(b'{"\xff\xfe":1}'),
    "a number of many digits": _with_header(b'{"a":' + b"9" * 10_000 + b"}"),
    "another project's": safetensors_numpy.save({"actor.0": np.zeros((2, 2), np.float32)}, {}),
}


@pytest.mark.parametrize("kind", _HOSTILE)
def test_files_that_are_no_policies_give_one_line(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "found.safetensors"
    path.write_bytes(_HOSTILE[kind])
    with pytest.raises(PolicyError, match=r"found\.safetensors cannot be played") as caught:
        mlp.load(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def _offsets(change: Callable[[dict[str, Any]], None]) -> bytes:
    """The forged file with a changed header."""
    content = _forged()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    change(header)
    return _with_header(json.dumps(header).encode(), content[8 + length :])


def _set(header: dict[str, Any], name: str, key: str, value: object) -> None:
    header[name][key] = value


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("layers.1.bias", "data_offsets", [0, 32]),  # within another tensor's bytes
        ("layers.0.bias", "data_offsets", [2**40, 2**40 + 64]),
        ("layers.0.bias", "data_offsets", [64, 0]),
        ("layers.0.bias", "data_offsets", [-64, 0]),
        ("layers.0.bias", "shape", [2**62, 2**62]),
        ("layers.0.bias", "shape", [-16]),
        ("layers.0.bias", "shape", [15]),
        ("layers.0.bias", "dtype", "F4096"),
        ("layers.0.bias", "dtype", "object"),
        ("layers.0.bias", "dtype", "F" * 100_000),
        ("layers.0.bias", "shape", "\n" * 300),
    ],
)
def test_headers_that_lie_about_the_bytes_give_one_line(name: str, key: str, value: object) -> None:
    content = _offsets(lambda header: _set(header, name, key, value))
    with pytest.raises(PolicyError, match="forged cannot be played") as caught:
        mlp.parse(content, "forged")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def _refusal(content: bytes) -> str | None:
    """The message with which a content is refused; None if it is a policy."""
    try:
        policy = mlp.parse(content, "fuzzed")
    except PolicyError as error:
        return str(error)
    assert policy.actions(np.zeros(9)).shape == (3,)
    return None


def test_changed_bytes_give_a_policy_or_one_line() -> None:
    content = _forged()
    stream = np.random.RandomState(5)
    changed = [content + b"\x00"]
    for _ in range(1500):
        array = np.frombuffer(content, np.uint8).copy()
        array[stream.randint(0, len(array), stream.randint(1, 4))] = stream.randint(0, 256)
        changed.append(array.tobytes())
    messages = [_refusal(each) for each in changed]
    refused = [message for message in messages if message is not None]
    assert 200 < len(refused) < 1300
    assert not [message for message in refused if "\n" in message]


def test_a_cut_file_is_never_a_policy() -> None:
    content = _forged()
    for length in range(len(content)):
        with pytest.raises(PolicyError, match="cut cannot be played"):
            mlp.parse(content[:length], "cut")


def test_weights_that_overflow_give_no_warning_and_no_action() -> None:
    tensors = {name: np.full_like(part, 3e38) for name, part in _tensors().items()}
    tensors["layers.2.weight"][:, ::2] *= -1
    actions = mlp.parse(_forged(tensors=tensors), "forged").actions(np.ones((64, 9)))
    assert np.isnan(actions).any()


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([], "it has 0 layers; expected 1 to 64"),
        (_drawn(9, 16, 8, 4), "sizes .9, 16, 8, 4., with 9 observations and 3 actions"),
        ([_LAYERS[0], _LAYERS[2]], "layer 1 has a weight of shape"),
        ([(np.full((3, 9), np.inf), np.zeros(3))], "layer 0 has numbers that are not finite"),
        ([(np.full((3, 9), 1e39), np.zeros(3))], "layer 0 has numbers that are not finite"),
        (_drawn(9, *[3] * 65), "it has 65 layers"),
    ],
)
def test_layers_that_do_not_fit_are_refused_as_they_are_saved(
    layers: list[mlp.Layer], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        mlp.save(tmp_path / "p", layers, _CARD)
    assert not list(tmp_path.iterdir())


def test_what_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="No such file"):
        mlp.load(tmp_path / "none.safetensors")
    with pytest.raises(PolicyError, match="directory"):
        mlp.load(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(PolicyError, match="is a pipe"):
            mlp.load(tmp_path / "pipe")


def test_a_file_that_is_too_large_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "large.safetensors"
    with open(path, "wb") as file:
        file.truncate(2**40)  # without taking room on the disk
    with pytest.raises(PolicyError, match="has more than 268435456 bytes"):
        mlp.load(path)


def test_the_format_is_imported_only_where_a_file_is_read_or_written() -> None:
    program = """
import sys
from limberjack import policies
from limberjack.policies import mlp
print("safetensors" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr


# Prints a hash of the actions of a policy, with as many threads for products as there may be.
_ACT = """
import hashlib, sys
import numpy as np
from threadpoolctl import ThreadpoolController
limited = ThreadpoolController().limit(limits=int(sys.argv[1]))
from limberjack.policies import mlp
random = np.random.RandomState(0)
sizes = [(1000, 64), (1000, 1000), (4, 1000)]  # with which two threads round in another way
layers = [(random.normal(size=size) / 32, np.zeros(size[0])) for size in sizes]
card = mlp.Card((("observations", (64,)),), (-1.0,) * 4, (1.0,) * 4)
actions = mlp.Mlp(layers, card).actions(random.normal(size=(64, 64)))
print(hashlib.sha256(actions.tobytes()).hexdigest())
"""


def test_actions_do_not_depend_on_the_number_of_cores() -> None:
    one, several = (run(_ACT, count) for count in ("1", "4"))
    assert one == several


def _threads() -> list[int]:
    """Those of each library of linear algebra."""
    found = ThreadpoolController().select(user_api="blas").info()
    return [library["num_threads"] for library in found]


@pytest.fixture
def two_threads() -> Iterator[None]:
    """Two threads for products, on a single core too."""
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        yield


@pytest.mark.usefixtures("two_threads")
def test_products_have_one_thread_until_the_context_ends() -> None:
    before = _threads()
    with mlp.one_thread():
        assert set(_threads()) <= {1}
        with mlp.one_thread():
            pass
        assert set(_threads()) <= {1}
    assert _threads() == before
    with pytest.raises(ZeroDivisionError), mlp.one_thread():
        raise ZeroDivisionError
    assert _threads() == before


@pytest.mark.usefixtures("two_threads")
def test_threads_take_turns() -> None:
    before, inside, most = _threads(), [0], [0]

    def multiply() -> None:
        for _ in range(10):
            with mlp.one_thread():
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0.001)  # in which another thread would enter
                np.ones((64, 64)) @ np.ones((64, 64))
                inside[0] -= 1

    several = [threading.Thread(target=multiply) for _ in range(4)]
    for thread in several:
        thread.start()
    for thread in several:
        thread.join()
    assert most == [1]
    assert _threads() == before
