"""Models of ONNX with a card, beside the networks that they were made of."""

import contextlib
import dataclasses
import itertools
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.evaluation import evaluate
from limberjack.policies import PolicyError, mlp, onnx
from limberjack.utils.requirements import install_command
from tests.policies.network_files import card_of, drawn, write
from tests.policies.test_onnx_models import CARD, REFUSED, content, onnx_models
from tests.rollouts import run_episode

_FORMS = [
    (activation, end, *norm)
    for activation, end, norm in itertools.product(
        mlp.ACTIVATIONS, mlp.ENDS, [(False, None), (True, None), (True, 2.0)]
    )
]


@pytest.fixture
def runtime() -> None:
    pytest.importorskip("onnxruntime", reason="needs the extra 'onnx'")


def _network(activation: str, end: str, is_normalised: bool, clip: float | None) -> mlp.Mlp:
    stream = np.random.RandomState(1)
    card = mlp.Card(
        layout=(("a", (4,)), ("b", (5,))),
        low=(-1.0, -0.1, 0.3),
        high=(1.0, 2.0, 0.7),
        activation=activation,
        end=end,
        action_repeat=3,
        mean=tuple(stream.randn(9).tolist()) if is_normalised else None,
        scale=tuple((0.1 + stream.rand(9)).tolist()) if is_normalised else None,
        clip=clip,
    )
    return mlp.Mlp(drawn(9, 32, 16, 3), card)


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_without_a_package_one_sentence_says_what_to_install(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "walk.onnx"
    path.write_bytes(content())
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, "limberjack.policies.onnx_models")
    monkeypatch.delattr(policies, "onnx_models")
    expected = f"needs the extra 'onnx': {install_command('onnx')}"
    with pytest.raises(ImportError, match=expected):
        onnx.load(path)
    environment = suite.load("walker", "walk", {"random": 0})
    with pytest.raises(PolicyError, match=rf"policy 'onnx:.*walk.onnx': {expected}"):
        policies.find(f"onnx:{path}", environment)


@pytest.mark.usefixtures("runtime")
@pytest.mark.parametrize(("activation", "end", "is_normalised", "clip"), _FORMS)
def test_a_model_acts_as_its_network_does(
    activation: str, end: str, is_normalised: bool, clip: float | None, tmp_path: Path
) -> None:
    network = _network(activation, end, is_normalised, clip)
    onnx.save(tmp_path / "p.onnx", network)
    model = onnx.load(tmp_path / "p.onnx")
    assert model.card == network.card
    observations = np.random.RandomState(2).randn(500, 9) * 3
    expected = network.actions(observations)
    found = model.actions(observations)
    assert found.dtype == np.float32
    # Sums of float32 in another order; docs/policies.md promises 1e-5.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    assert model.actions(observations[0]).shape == (3,)
    by_name = {"b": observations[:, 4:], "c": observations, "a": observations[:, :4]}
    np.testing.assert_array_equal(model.act_batch(by_name), found)


@pytest.mark.usefixtures("runtime")
@pytest.mark.parametrize("end", mlp.ENDS)
def test_the_bounds_are_in_the_model_too(end: str) -> None:
    card = dataclasses.replace(CARD, end=end, low=(-0.1,), high=(0.1,))
    network = mlp.Mlp([(np.full((1, 3), 50.0), np.zeros(1))], dataclasses.replace(card, sizes=()))
    model = onnx.parse(onnx.content_of(network), "bounded")
    x = np.array([[1, 1, 1], [-1, -1, -1]], np.float32)
    np.testing.assert_array_equal(model._run(x), network.actions(x))


@pytest.mark.usefixtures("runtime")
@pytest.mark.parametrize("bundled", policies.bundled(), ids=lambda one: one.path.stem)
def test_each_bundled_policy_is_a_model_too(bundled: policies.Bundled) -> None:
    network = mlp.load(bundled.path)
    model = onnx.parse(onnx.content_of(network), "bundled")
    observations = np.random.RandomState(0).randn(200, network.card.num_observations)
    half_range = np.subtract(network.card.high, network.card.low) / 2
    difference = (model.actions(observations) - network.actions(observations)) / half_range
    assert np.abs(difference).max() <= 1e-5


@pytest.mark.usefixtures("runtime")
def test_a_model_is_played_by_its_name(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    onnx.save(tmp_path / "p.onnx", mlp.load(tmp_path / "p"))
    totals = []
    for one in (name, f"onnx:{tmp_path / 'p.onnx'}"):
        environment = suite.load("walker", "walk", {"random": 7, "time_limit": 0.5})
        actor = policies.find(one, environment)
        assert actor.action_repeat == 2
        totals.append(run_episode(environment, actor, 7).total)
        played = evaluate("walker", "walk", one, range(7, 8), time_limit=0.5)
        assert played.scores[one][0].total == totals[-1]
    # Actions that differ in their last bits, over 20 control steps.
    assert totals[0] == pytest.approx(totals[1], rel=1e-3)


@pytest.mark.usefixtures("runtime")
def test_a_model_that_does_not_fit_is_refused_by_name(tmp_path: Path) -> None:
    card = card_of("walker", "walk")
    onnx.save(tmp_path / "p.onnx", mlp.Mlp(drawn(card.num_observations, 6), card))
    environment = suite.load("cheetah", "run", {"random": 0})
    with pytest.raises(PolicyError, match="does not fit: it takes an observation 'orientations'"):
        policies.find(f"onnx:{tmp_path / 'p.onnx'}", environment)


@pytest.mark.usefixtures("runtime")
def test_a_model_of_flat_observations_is_played_with_those_of_the_task(tmp_path: Path) -> None:
    card = card_of("walker", "walk", layout=(("observations", (24,)),))
    network = mlp.Mlp(drawn(24, 8, 6), card)
    onnx.save(tmp_path / "p.onnx", network)
    environment = suite.load("walker", "walk", {"random": 0, "time_limit": 0.2})
    actor = policies.find(f"onnx:{tmp_path / 'p.onnx'}", environment)
    time_step = environment.reset()
    flat = np.concatenate([np.ravel(part) for part in time_step.observation.values()])
    action = actor.begin_alone(environment, 0)(time_step.observation)
    # As above.
    np.testing.assert_allclose(action, network.actions(flat), rtol=0, atol=1e-5)


@pytest.mark.usefixtures("runtime")
def test_a_model_of_another_program_becomes_a_policy_with_a_card() -> None:
    graph = onnx_models.Graph()
    x = graph.add("LayerNormalization", onnx_models.INPUT, graph.constant(np.ones(3)))
    graph.add("Gemm", x, graph.constant(np.full((1, 3), 4.0)), transB=1, result=onnx_models.OUTPUT)
    card = dataclasses.replace(CARD, sizes=())
    policy = onnx.parse(onnx.carded(graph.model(3, 1), card), "theirs")
    assert policy.card.sizes == (3, 1)
    x = np.array([[1.0, 2.0, 6.0], [5.0, 5.0, -9.0]])
    np.testing.assert_allclose(policy.actions(x), [[0.0], [0.0]], atol=1e-5)  # a mean of 0
    with pytest.raises(ValueError, match="has 2 cards"):
        onnx.carded(onnx.carded(graph.model(3, 1), card), card)
    with pytest.raises(ValueError, match="its layers have sizes"):
        onnx.carded(graph.model(3, 1), dataclasses.replace(CARD, sizes=(4, 1)))


@pytest.mark.usefixtures("runtime")
def test_actions_are_clipped_to_the_bounds_of_the_card() -> None:
    graph = onnx_models.Graph()
    weight = graph.constant(np.full((1, 3), 100.0))
    graph.add("Gemm", onnx_models.INPUT, weight, transB=1, result=onnx_models.OUTPUT)
    policy = onnx.parse(onnx.carded(graph.model(3, 1), CARD), "theirs")
    np.testing.assert_array_equal(policy.actions([[1, 1, 1], [-1, -1, -1]]), [[2.0], [-1.0]])
    with pytest.raises(ValueError, match=r"observation has shape \(2,\); expected \(\.\.\., 3\)"):
        policy.actions([1.0, 2.0])


def _of_form(graph: Any, *size: int) -> bytes:
    return onnx.carded(graph.model(*size), CARD)


def _other_models() -> dict[str, tuple[bytes, str]]:
    """Models that the check accepts, and that are no policies."""
    wide, late, unknown, lacking = (
        onnx_models.Graph(),
        onnx_models.Graph(),
        onnx_models.Graph(),
        onnx_models.Graph(),
    )
    wide.add("Relu", onnx_models.INPUT, result=onnx_models.OUTPUT)
    shape = late.constant(np.array([1.0, -1.0]))
    late.add("Reshape", onnx_models.INPUT, late.cast(shape, 7), result=onnx_models.OUTPUT)
    unknown.add("Nonsense", onnx_models.INPUT, result=onnx_models.OUTPUT)
    lacking.add("Relu", "nothing", result=onnx_models.OUTPUT)
    one_row = onnx_models.onnx.ModelProto.FromString(wide.model(3, 1))
    one_row.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
    return {
        "outputs of another size": (_of_form(wide, 3, 3), "its outputs are"),
        "inputs of another size": (_of_form(wide, 4, 1), "its inputs are|refuses it"),
        "a shape that is not kept": (_of_form(late, 3, 1), "returned shape|refuses it|its outputs"),
        "an operator that does not exist": (_of_form(unknown, 3, 1), "the runtime refuses it"),
        "a value that does not exist": (_of_form(lacking, 3, 1), "the runtime refuses it"),
        "one row": (onnx.carded(one_row.SerializeToString(), CARD), "first axis|refuses it"),
    }


@pytest.mark.usefixtures("runtime")
@pytest.mark.parametrize("kind", [*REFUSED, *_other_models()])
def test_files_that_are_no_policies_give_one_line(
    kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "found.onnx"
    made, message = {**REFUSED, **_other_models()}[kind]
    path.write_bytes(made)
    with pytest.raises(PolicyError, match=r"found\.onnx cannot be played") as caught:
        onnx.load(path)
    assert caught.match(message)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700
    assert capfd.readouterr() == ("", "")


def _refusal(damaged: bytes) -> str | None:
    """The message with which a content is refused; None if it is a policy."""
    try:
        policy = onnx.parse(damaged, "damaged")
    except PolicyError as error:
        return str(error)
    with contextlib.suppress(PolicyError):
        assert policy.actions(np.zeros((2, 3))).shape == (2, 1)
    return None


@pytest.mark.usefixtures("runtime")
def test_damaged_files_are_refused_or_play() -> None:
    whole = content()
    stream = np.random.RandomState(0)
    messages = []
    for _ in range(300):
        damaged = bytearray(whole)
        for at in stream.randint(len(whole), size=1 + stream.randint(3)):
            damaged[at] = stream.randint(256)
        messages.append(_refusal(bytes(damaged)))
    refused = [message for message in messages if message is not None]
    assert len(refused) > 150
    assert not any("\n" in message for message in refused)


@pytest.mark.parametrize("kind", ["missing", "folder"])
def test_a_file_that_cannot_be_read_is_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path if kind == "folder" else tmp_path / "none.onnx"
    with pytest.raises(PolicyError, match=path.name):
        onnx.load(path)
