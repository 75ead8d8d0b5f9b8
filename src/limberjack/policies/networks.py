"""Networks in files as policies: `mlp:PATH`, `onnx:PATH`, and `pretrained`, a task's bundled one.

    actor = network_policy("mlp:walk.safetensors", content, environment)
    actor = pretrained(environment)
    for one in bundled():
        print(one.domain, one.task, one.card.scores)

A network is shown 64 rows, as other policies that act on batches are, so that an episode is the
same whichever command plays it. It must fit the environment: the observations' names and shapes,
and the actions' number and bounds. Where only the model or MuJoCo's version is another one than
that of its scores, it plays, and a line is logged.
"""

import copy
import dataclasses
import functools
import hashlib
import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack import registry, suite
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import mlp, onnx
from limberjack.policies.actors import Batched, Deferred
from limberjack.policies.kinds import Act, Actor, PolicyError
from limberjack.rl.action_specs import open_bounds, spec_of
from limberjack.rl.control import Environment
from limberjack.rl.copies import control_of
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.rl.row_step import as_mapping
from limberjack.utils.log import log

__all__ = [
    "OTHER_SCORES",
    "PRETRAINED",
    "Bundled",
    "Network",
    "bundled",
    "check_fit",
    "layout_of",
    "loaded_policy",
    "network_policy",
    "pretrained",
]

PRETRAINED = "pretrained"
OTHER_SCORES = "policy %r: its scores are those of %s"  # logged; commands print it

Network = mlp.Mlp | onnx.OnnxPolicy

_FOLDER = Path(__file__).parent / PRETRAINED
_ENDING = ".safetensors"


@dataclasses.dataclass(frozen=True)
class Bundled:
    """A policy of a task that the package brings.

    Attributes:
      domain, task: of the suite.
      path: of the file, for `mlp.load`.
      card: see `mlp.Card`.
      nbytes: of the file.
      sha256: of the file.
    """

    domain: str
    task: str
    path: Path
    card: mlp.Card
    nbytes: int
    sha256: str


def bundled() -> list[Bundled]:
    """The policies that the package brings, in the order of their names.

    Raises:
      PolicyError: a file of the package is damaged.
    """
    found = []
    for path in sorted(_FOLDER.glob(f"*{_ENDING}")):
        domain, _, task = path.stem.partition("-")
        content = mlp.read(path)
        card = mlp.parse(content, str(path)).card
        sha256 = hashlib.sha256(content).hexdigest()
        found.append(Bundled(domain, task, path, card, len(content), sha256))
    return found


def pretrained(environment: dm_env.Environment | None) -> Actor:
    """The bundled policy of an environment's task.

    Args:
      environment: of the suite, or around one; None to find the policy as an episode begins.

    Raises:
      PolicyError: the task has none, or the environment is another one than the suite's.
    """
    if environment is None:
        return Deferred(PRETRAINED, pretrained)
    inner = control_of(environment)
    name = inner._ours.name if isinstance(inner, Environment) else ""
    domain, _, task = name.partition(":")
    path = _FOLDER / f"{domain}-{task}{_ENDING}"
    if not (name and path.is_file()):
        named = f"{domain} {task} has none" if name else "this environment is no task of the suite"
        tasks = sorted(file.stem.replace("-", " ", 1) for file in _FOLDER.glob(f"*{_ENDING}"))
        choice = f"these tasks have one: {', '.join(tasks)}" if tasks else "no task has one here"
        raise PolicyError(f"policy {PRETRAINED!r}: {named}; {choice}")
    return network_policy(PRETRAINED, mlp.read(path), environment)


def network_policy(
    name: str,
    content: bytes,
    environment: dm_env.Environment,
    parse: Callable[[bytes, str], Network] = mlp.parse,
) -> Actor:
    """The policy in a file; its episodes are independent of each other.

    Args:
      name: for results and messages.
      content: of the file.
      environment: the one to act in.
      parse: gives the network in the content of a file with a title.

    Raises:
      PolicyError: it is no such file, or the policy does not fit the environment.
    """
    policy = parse(content, f"policy {name!r}")
    return _acting(name, hashlib.sha256(content).hexdigest(), policy, environment)


def loaded_policy(name: str, policy: Network, environment: dm_env.Environment | None) -> Actor:
    """The policy that a network in memory is, at its card's action repeat; see `network_policy`.

    With None as environment the network is checked as its first episode begins.
    """
    if environment is None:
        return Deferred(name, lambda found: loaded_policy(name, policy, found))
    sha256 = None
    if isinstance(policy, mlp.Mlp):
        parts = [part.tobytes() for layer in policy.layers for part in layer]
        sha256 = hashlib.sha256(b"".join([policy.card.as_text().encode(), *parts])).hexdigest()
    return _acting(name, sha256, policy, environment)


def _acting(
    name: str, sha256: str | None, policy: Network, environment: dm_env.Environment
) -> Actor:
    actor = _Network(name, sha256, policy, environment)
    others = _differences(policy.card, environment)
    if others:
        log.warning(OTHER_SCORES, name, " and ".join(others))
    return actor


class _Network(Batched):
    """A network, which acts on 64 rows at once."""

    def __init__(
        self, name: str, sha256: str | None, policy: Network, environment: dm_env.Environment
    ) -> None:
        """Raises PolicyError if the policy does not fit the environment."""
        super().__init__(name, sha256, _fitted(name, policy, environment).act_batch)
        self._policy = policy
        self.action_repeat = policy.card.action_repeat

    def begin_alone(self, environment: dm_env.Environment, seed: int) -> Act:
        """See `Actor`; the environment may be another one than before."""
        fitted = _fitted(self.name, self._policy, environment)
        act = Batched(self.name, self.sha256, fitted.act_batch).begin_alone(environment, seed)
        return _repeating(act, self._steps_per_action(environment))

    def _steps_per_action(self, environment: dm_env.Environment) -> int:
        """Steps of the environment for which an action is repeated."""
        own = getattr(control_of(environment), "action_repeat", 1)
        demanded = self._policy.card.action_repeat
        if own not in (1, demanded):
            raise PolicyError(
                f"policy {self.name!r} acts every {demanded} control steps, and the environment "
                f"has action_repeat={own}; expected {demanded}, or 1"
            )
        return 1 if own == demanded else demanded


def _repeating(act: Act, count: int) -> Act:
    """The function that is asked at every `count`-th step only."""
    if count == 1:
        return act
    steps = itertools.count()
    action = np.zeros(0)

    def repeated(observation: Mapping[str, np.ndarray]) -> np.ndarray:
        nonlocal action
        if next(steps) % count == 0:
            action = act(observation)
        return action.copy()

    return repeated


def layout_of(environment: dm_env.Environment) -> mlp.Layout:
    """Names and shapes of an environment's observations in their order, without pictures."""
    spec = cast(Mapping[str, specs.Array], as_mapping(environment.observation_spec()))
    return tuple(
        (name, tuple(one.shape))
        for name, one in spec.items()
        if not (name == PIXELS_KEY and one.dtype == np.uint8)
    )


def check_fit(name: str, card: mlp.Card, environment: dm_env.Environment) -> None:
    """Checks that a policy takes an environment's observations and returns actions of it.

    Raises:
      PolicyError: it does not; the message names the first observation or action that differs.
    """
    problem = _of_observations(card, environment) or _of_actions(card, environment)
    if problem is not None:
        raise PolicyError(f"policy {name!r} does not fit: {problem}")


def _fitted(name: str, policy: Network, environment: dm_env.Environment) -> Network:
    """The policy with the environment's layout; raises PolicyError if it does not fit."""
    check_fit(name, policy.card, environment)
    here = layout_of(environment)
    if _is_flat(here):
        return policy.with_layout(here)
    return policy.with_layout(_flat_layout(environment)) if _is_flat(policy.card.layout) else policy


def _flat_layout(environment: dm_env.Environment) -> mlp.Layout:
    """Names and shapes in the order of a flat observation, as far as it can be told."""
    here, inner = layout_of(environment), control_of(environment)
    if not isinstance(inner, Environment):
        return here
    known = tuple(inner._flat_layout())
    is_whole = _size(known) == _size(here) if _is_flat(here) else {*known} == {*here}
    return known if is_whole else here  # a wrapper observes something else


def _size(layout: mlp.Layout) -> int:
    return sum(math.prod(shape) for _, shape in layout)


def _is_flat(layout: mlp.Layout) -> bool:
    return [name for name, _ in layout] == [FLAT_OBSERVATION_KEY]


def _of_observations(card: mlp.Card, environment: dm_env.Environment) -> str | None:
    """The first difference between the policy's observations and the environment's, or None."""
    here = layout_of(environment)
    takes, has = dict(card.layout), dict(here)
    if _is_flat(here) or _is_flat(card.layout):
        size = _size(here)
        if size != card.num_observations:
            return f"it takes {card.num_observations} numbers as observation; the task has {size}"
        joined = [name for name, _ in _flat_layout(environment)]
        if joined in ([*has], [*takes]) or _is_flat(card.layout):
            return None
        return (
            f"it takes {', '.join(takes)} in this order, and the flat observation has "
            f"{', '.join(joined)}: make the environment without flat_observation"
        )
    for name in {**takes, **has}:
        if name not in has:
            return f"it takes an observation {name!r}, and the task has {', '.join(has)}"
        if name not in takes:
            return f"the task has an observation {name!r}, and it takes {', '.join(takes)}"
        if takes[name] != has[name]:
            return f"it takes {name!r} of shape {takes[name]}; the task's has {has[name]}"
    return None


def _of_actions(card: mlp.Card, environment: dm_env.Environment) -> str | None:
    """The difference between the policy's actions and the environment's; None if there is none."""
    try:
        spec = spec_of(environment)
    except (TypeError, ValueError) as error:
        return str(error)
    if spec.shape != (len(card.low),):
        return f"its actions have shape {(len(card.low),)}; the task's have {spec.shape}"
    low, high = open_bounds(spec)
    with np.errstate(over="ignore"):  # a bound of a file may be beyond float32
        # In which other libraries have their bounds: 0.1 is larger there.
        given = card.low, card.high, low, high
        least, most, task_least, task_most = (np.asarray(one, np.float32) for one in given)
    is_out = (least < task_least) | (most > task_most)
    if not is_out.any():
        return None
    first = int(np.flatnonzero(is_out)[0])
    return (
        f"its action {first} reaches from {card.low[first]:g} to {card.high[first]:g}; the task's "
        f"from {low[first]:g} to {high[first]:g}"
    )


def _differences(card: mlp.Card, environment: dm_env.Environment) -> list[str]:
    """Ways in which the policy's scores are those of other episodes than the environment's."""
    inner = control_of(environment)
    if not isinstance(inner, Environment):
        return []
    found = []
    name = f"{card.domain}:{card.task}"
    if card.title and inner._ours.name and inner._ours.name != name:
        found.append(card.title)
    known, here = card.versions.get("mujoco"), versions()["mujoco"]
    if known not in (None, here):
        found.append(f"MuJoCo {known}, not {here}")
    if not found and card.fingerprint and not _is_model_of(card, inner):
        found.append("another model than this one")
    return found


def _is_model_of(card: mlp.Card, environment: Environment) -> bool:
    """Whether an environment has the model that the policy was trained on."""
    if fingerprint(environment.physics.model._official) == card.fingerprint:
        return True
    known = registry.domains().get(card.domain)
    if known is None or card.task not in [row.task for row in known.rows]:
        return False
    # A start may have set fields of this model, and a film needs a larger buffer.
    original, cleared = _of_new(card.domain, card.task)
    return original == card.fingerprint and _cleared(environment) == cleared


@functools.cache
def _of_new(domain: str, task: str) -> tuple[str, str]:
    """The fingerprints of a new environment's model: as it is, and of `_cleared`."""
    environment = suite.load(domain, task, {"random": 0})
    inner = control_of(environment)
    assert isinstance(inner, Environment)
    try:
        return fingerprint(inner.physics.model._official), _cleared(inner)
    finally:
        environment.close()


def _cleared(environment: Environment) -> str:
    """The fingerprint of the model without what starts set and what only pictures depend on."""
    model = copy.copy(environment.physics.model._official)
    for name in environment._saved_fields():
        owner, field = (model.opt, name[4:]) if name.startswith("opt.") else (model, name)
        setattr(owner, field, np.zeros_like(getattr(owner, field)))
    model.vis.global_.offwidth = model.vis.global_.offheight = 0
    return fingerprint(model)
