"""`export`: a model of Stable-Baselines3 as a policy file, which needs no PyTorch to be played.

    card = export("sb3:walk.zip", "walk.safetensors", task=("walker", "walk"), action_repeat=2)

PPO, A2C, SAC, TD3, DDPG, and TRPO, TQC and CrossQ of sb3-contrib, with fully connected layers. The
file acts as the model does without exploration: both are compared before the file is written. Batch
normalisation is folded into the layers, and a `VecNormalize` beside the model becomes the card's
`mean`, `scale` and `clip`.

A file whose name ends in .onnx is a model of ONNX with the same card, and needs the extra `onnx`.

Networks on pictures, of several observations through layers of their own, and with other layers
than those of `policies.mlp` are refused by name.
"""

import contextlib
import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from limberjack import suite
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import mlp, onnx
from limberjack.policies.kinds import PolicyError
from limberjack.policies.networks import check_fit, layout_of
from limberjack.policies.saved import read_model, runs_code
from limberjack.rl.guards import at_least_one
from limberjack.rl.observations import FLAT_OBSERVATION_KEY

__all__ = ["export"]

_LARGEST_DIFFERENCE = 1e-5  # of an action, as a part of half of its range
_TRIALS = 256  # observations that are compared

# Layers of PyTorch that are the format's activations, with the settings that they have by default;
# with others, or in another order, the file would act otherwise, which `_check_equal` refuses.
_ACTIVATIONS = {
    "ReLU": "relu",
    "ReLU6": "relu6",
    "LeakyReLU": "leaky_relu",
    "ELU": "elu",
    "SiLU": "silu",
    "Tanh": "tanh",
    "_Squash": "tanh",
}
_WITHOUT_EFFECT = (
    "Dropout",
    "Flatten",
    "Identity",
)  # on an action, in a policy that does not train
_ALGORITHMS = ("SAC", "TD3", "TQC", "CrossQ")

# Any, in this file: classes of SB3 and PyTorch, which it does not import.
_Foreign = Any


def export(
    policy: str,
    out: Path | str,
    *,
    task: tuple[str, str] | None = None,
    action_repeat: int = 1,
) -> mlp.Card:
    """Writes the policy of a saved model to a file, in the place of a file of that name.

    Args:
      policy: `sb3:PATH`; the file contains pickled Python, which runs.
      out: the file, which by custom ends in .safetensors; of ONNX if it ends in .onnx.
      task: domain and task that it was trained on, which the model does not know. With it the card
        has the names of the observations, and the policy is refused in tasks with others; without
        it, in tasks with another number.
      action_repeat: control steps per action in training.

    Returns:
      The card.

    Raises:
      PolicyError: there is no such model, it has no form in the format, or `out` is its file.
      ValueError, TypeError: there is no such task, or a number is out of range.
      OSError: the file cannot be written.
    """
    repeat = at_least_one("action_repeat", action_repeat)
    is_onnx = Path(out).suffix == onnx.ENDING
    if not runs_code(policy):
        raise PolicyError(f"policy is {policy!r}; expected sb3:PATH, a model to export")
    if task is not None:
        if isinstance(task, str) or len(task) != 2:
            raise TypeError(
                f"task is {task!r}; expected a domain and a task, as ('walker', 'walk')"
            )
        suite.load(*task).close()  # refused before the code in the model runs
    try:
        from limberjack import sb3

        files = read_model(policy)
        _check_other(files, Path(out))
        model = sb3.SavedModel(files)
        network = _converted(model, repeat)
        _check_equal(model, network)
        if is_onnx:
            _check_equal(model, onnx.parse(onnx.content_of(network), str(out)))
    except PolicyError:
        raise
    except (ImportError, ValueError) as error:
        raise PolicyError(f"policy {policy!r}: {error}") from None
    card = network.card
    if task is not None:
        card = _of_task(policy, card, *task)
    if is_onnx:
        onnx.save(out, mlp.Mlp(network.layers, card))
    else:
        mlp.save(out, network.layers, card)
    return card


def _check_other(files: Iterable[Path], out: Path) -> None:
    """Raises ValueError if a policy file would replace one of the model's."""
    for file in files:
        if out.exists() and out.samefile(file):
            raise ValueError(f"{out} is the model itself: choose another file for the policy")


def _converted(model: _Foreign, action_repeat: int) -> mlp.Mlp:
    """The network of a model; raises ValueError if it has no form in the format."""
    actions = model.data["action_space"]
    if getattr(actions, "low", None) is None or len(actions.shape) != 1:
        raise ValueError(f"its actions are {actions}; expected a box of one axis")
    layers, activations, end = _layers(_modules(model.policy))
    if len(activations) > 1:
        raise ValueError(f"its activations are {' and '.join(sorted(activations))}; expected one")
    layout = _layout(model.data["observation_space"])
    mean, scale, clip = _normalisation(model.normalisation, layout)
    steps, seed = model.data.get("num_timesteps"), model.data.get("seed")
    card = mlp.Card(
        layout=layout,
        low=tuple(actions.low.tolist()),
        high=tuple(actions.high.tolist()),
        activation=next(iter(activations), "relu"),
        end=end,
        action_repeat=action_repeat,
        algorithm=_algorithm(model.data),
        seeds=() if seed is None else (int(seed),),
        steps=None if steps is None else int(steps) * action_repeat,
        versions=versions(),
        mean=mean,
        scale=scale,
        clip=clip,
    )
    return mlp.Mlp(layers, card)


def _of_task(policy: str, card: mlp.Card, domain: str, task: str) -> mlp.Card:
    """The card with a task; raises PolicyError if the policy does not fit it."""
    with contextlib.closing(suite.load(domain, task, {"random": 0})) as environment:
        check_fit(policy, card, environment)
        is_flat = [name for name, _ in card.layout] == [FLAT_OBSERVATION_KEY]
        return dataclasses.replace(
            card,
            domain=domain,
            task=task,
            # That of a dictionary is in the model's own order.
            layout=layout_of(environment) if is_flat else card.layout,
            fingerprint=fingerprint(environment.physics.model._official),
        )


def _algorithm(data: Mapping[str, _Foreign]) -> str:
    """The name of the algorithm that saved these settings; DDPG is a kind of TD3."""
    kind = data["policy_class"]
    for base in kind.__mro__:
        if base.__name__ == "ActorCriticPolicy":
            of_setting = {"clip_range": "PPO", "cg_max_steps": "TRPO"}
            return next((of_setting[name] for name in of_setting if name in data), "A2C")
        if (name := base.__name__.removesuffix("Policy")) in _ALGORITHMS:
            return name
    return kind.__name__


def _layout(space: _Foreign) -> mlp.Layout:
    """Names and shapes of a space of observations, in the order in which the model joins them."""
    spaces = getattr(space, "spaces", {FLAT_OBSERVATION_KEY: space})
    for name, one in spaces.items():
        if getattr(one, "shape", None) is None or one.dtype.kind != "f":
            raise ValueError(f"its observation {name!r} is {one}; expected a box of numbers")
    return tuple((str(name), tuple(map(int, one.shape))) for name, one in spaces.items())


def _normalisation(
    saved: _Foreign, layout: mlp.Layout
) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None, float | None]:
    """The mean, the scale and the clip of the card for a `VecNormalize`."""
    if saved is None or not saved.norm_obs:
        return None, None, None
    names = [name for name, _ in layout]
    found: _Foreign = saved.obs_rms
    shared: dict[str, _Foreign] = dict.fromkeys(names, found)
    statistics = found if isinstance(found, Mapping) else shared
    lacking = [name for name in names if name not in statistics]
    if lacking:
        raise ValueError(f"its VecNormalize leaves {', '.join(lacking)} as it is, and not others")
    mean = np.concatenate([np.ravel(statistics[name].mean) for name in names])
    var = np.concatenate([np.ravel(statistics[name].var) for name in names])
    scale = np.sqrt(var + saved.epsilon)
    clip = float(saved.clip_obs) if math.isfinite(saved.clip_obs) else None
    return tuple(mean.astype(float).tolist()), tuple(scale.astype(float).tolist()), clip


def _modules(policy: _Foreign) -> list[_Foreign]:
    """The modules from the observation to the action, in order."""
    actor = getattr(policy, "actor", None) or policy
    if hasattr(actor, "lstm_actor"):
        raise ValueError("it is recurrent, and a policy file has no memory")
    extractor = getattr(actor, "pi_features_extractor", None) or actor.features_extractor
    flattens = [*getattr(extractor, "extractors", {"": extractor}).values()]
    for one in flattens:
        if type(one).__name__ not in ("Flatten", "FlattenExtractor"):
            raise ValueError(
                f"its observations pass a {type(one).__name__}, which has no form there"
            )
    if hasattr(actor, "mlp_extractor"):
        found = [*actor.mlp_extractor.policy_net, actor.action_net]
        ends = [_Squash()] if actor.use_sde and actor.squash_output else []
    elif hasattr(actor, "latent_pi"):
        found, ends = [*actor.latent_pi, actor.mu], [_Squash()]
    elif hasattr(actor, "mu"):
        found, ends = [actor.mu], []
    else:
        raise ValueError(f"a {type(policy).__name__} has no layers that are known here")
    return [*_flattened(found), *ends]


class _Squash:
    """The tanh of a distribution, which is no module of the network."""


def _flattened(modules: Iterable[_Foreign]) -> list[_Foreign]:
    """The modules, with those of each sequence in its place."""
    found = []
    for module in modules:
        found += _flattened(module) if type(module).__name__ == "Sequential" else [module]
    return found


def _layers(modules: list[_Foreign]) -> tuple[list[mlp.Layer], set[str], str]:
    """The layers, the kinds of activations between them, and the end."""
    layers: list[mlp.Layer] = []
    activations: list[str] = []  # after each layer, or fewer
    before: list[tuple[np.ndarray, np.ndarray]] = []  # normalisations before the next layer
    for module in modules:
        name = type(module).__name__
        is_after_layer = len(activations) < len(layers)
        if name == "Linear":
            layers.append(_folded(_linear(module), before))
            before = []
        elif name in ("BatchNorm1d", "BatchRenorm1d"):
            affine = _affine(module)
            if is_after_layer:
                weight, bias = (np.asarray(part) for part in layers[-1])
                layers[-1] = weight * affine[0][:, None], bias * affine[0] + affine[1]
            else:
                before.append(affine)
        elif name in _ACTIVATIONS:
            activations.append(_ACTIVATIONS[name])
        elif name not in _WITHOUT_EFFECT:
            raise ValueError(f"it has a {name}, which has no form in a policy file")
    return _ended(layers, activations, bool(before))


def _ended(
    layers: list[mlp.Layer], activations: list[str], has_more: bool
) -> tuple[list[mlp.Layer], set[str], str]:
    if has_more or not layers:
        raise ValueError("it does not end in a layer, with or without a tanh")
    end = activations.pop() if len(activations) == len(layers) else "none"
    if end not in mlp.ENDS:
        raise ValueError(f"its last layer ends in {end}; expected {' or '.join(mlp.ENDS)}")
    return layers, set(activations), end


def _linear(module: _Foreign) -> mlp.Layer:
    weight = _numbers(module.weight)
    return weight, np.zeros(len(weight)) if module.bias is None else _numbers(module.bias)


def _affine(module: _Foreign) -> tuple[np.ndarray, np.ndarray]:
    """The gain and the offset of a batch normalisation that acts without a batch's statistics."""
    is_renorm = type(module).__name__ == "BatchRenorm1d"
    mean, var = (
        (module.ra_mean, module.ra_var) if is_renorm else (module.running_mean, module.running_var)
    )
    if mean is None:
        raise ValueError("it has a batch normalisation without running statistics")
    measured = _numbers(mean), _numbers(var), module.eps
    if not module.affine:
        return mlp.affine(*measured)
    scale = module.scale if is_renorm else module.weight
    return mlp.affine(*measured, _numbers(scale), _numbers(module.bias))


def _folded(layer: mlp.Layer, before: list[tuple[np.ndarray, np.ndarray]]) -> mlp.Layer:
    for gain, offset in reversed(before):
        layer = mlp.folded(layer, gain, offset)
    return layer


def _numbers(tensor: _Foreign) -> np.ndarray:
    return tensor.detach().cpu().numpy().astype(np.float64)


def _check_equal(model: _Foreign, network: mlp.Mlp | onnx.OnnxPolicy) -> None:
    """Raises ValueError unless the file would act as the model does at drawn observations."""
    card = network.card
    drawn = np.random.RandomState(0).randn(_TRIALS, card.num_observations)
    if card.mean is not None and card.scale is not None:
        drawn = np.array(card.mean) + np.array(card.scale) * drawn
    flat = drawn.astype(np.float32)
    seen = _seen(model.data["observation_space"], flat, card.layout)
    if model.normalisation is not None:
        seen = model.normalisation.normalize_obs(seen)
    expected, _ = model.policy.predict(seen, deterministic=True)
    # Bounds may be far wider than the actions, and their float32 coarser than their range.
    scale = np.minimum(np.subtract(card.high, card.low) / 2, np.maximum(np.abs(expected), 1.0))
    difference = np.abs(network.actions(flat) - expected)
    worst = float(np.max((difference - 4 * np.spacing(np.abs(expected))) / scale))
    if not worst <= _LARGEST_DIFFERENCE:
        raise ValueError(f"the file would act otherwise: an action differs by {worst:.2g}")


def _seen(space: _Foreign, flat: np.ndarray, layout: mlp.Layout) -> _Foreign:
    """Flat observations in the form of a space."""
    if not hasattr(space, "spaces"):
        return flat.reshape(len(flat), *space.shape)
    ends = np.cumsum([math.prod(shape) for _, shape in layout])
    parts = zip(layout, np.split(flat, ends[:-1], axis=-1), strict=True)
    return {name: part.reshape(len(flat), *shape) for (name, shape), part in parts}
