"""Facts about a task, read from the registry, the task and its compiled model.

    facts = domain_facts.read("humanoid", "walk")
    facts.observations[1]    # Observation(key='head_height', shape='()', flat='21:22', ...)

Every fact is text, as the tables of `domain_pages` print it. Nothing here knows a domain by name.
"""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

import mujoco

from limberjack import suite
from limberjack.mujoco import Physics

__all__ = ["Action", "Facts", "Joint", "Measurement", "Observation", "Term", "read"]

_TAGS = ("benchmarking", "easy", "hard", "extra")
_KINDS_OF_JOINTS = {
    int(mujoco.mjtJoint.mjJNT_FREE): ("free", 7, 6),  # numbers in qpos and in qvel
    int(mujoco.mjtJoint.mjJNT_BALL): ("ball", 4, 3),
    int(mujoco.mjtJoint.mjJNT_SLIDE): ("slide", 1, 1),
    int(mujoco.mjtJoint.mjJNT_HINGE): ("hinge", 1, 1),
}
_TRN, _BIAS = mujoco.mjtTrn, mujoco.mjtBias


class Observation(NamedTuple):
    """A row of the table of observations."""

    key: str
    shape: str
    flat: str  # place in the flat observation, such as '21:22'
    unit: str
    meaning: str


class Action(NamedTuple):
    """A row of the table of actions."""

    action: str
    actuator: str
    kind: str  # motor, position, velocity or general
    range: str
    gear: str
    unit: str  # of the gear times the action
    joint: str  # or the site or body that it acts on


class Joint(NamedTuple):
    """A row of the table of joints."""

    joint: str
    kind: str
    range: str
    qpos: str
    qvel: str


class Term(NamedTuple):
    """A row of the table of the reward's terms."""

    term: str
    goal: str  # 'yes' where it must reach 0.9 for success


class Measurement(NamedTuple):
    """A row of the table of the methods of the domain's physics."""

    method: str
    gives: str


@dataclass(frozen=True)
class Facts:
    """Everything that the pages print about a task."""

    domain: str
    task: str
    wants: str
    tags: tuple[str, ...]
    steps: str
    time_limit: str
    control_timestep: str
    physics_steps: str
    observations: tuple[Observation, ...]
    partly: tuple[str, ...]  # keys with `fully_observable=False`; empty if there is no such option
    actions: tuple[Action, ...]
    joints: tuple[Joint, ...]
    terms: tuple[Term, ...]
    starts: tuple[str, ...]
    cameras: tuple[str, ...]
    measurements: tuple[Measurement, ...]
    kind: type  # the task's class


# Any: the factories' environments, whose physics and task are the domain's own classes.
_Environment = Any


def read(domain: str, task: str) -> Facts:
    """The facts about a task.

    Raises:
      ValueError: there is no such domain or task.
    """
    module = suite.module_of(domain)
    with suite.load(domain, task, {"random": 0}) as env:
        env.reset()
        return _facts(module, domain, task, env)


def _facts(module: ModuleType, domain: str, task: str, env: _Environment) -> Facts:
    model = env.physics.model.ptr
    limit = env.step_limit
    substeps = round(env.control_timestep() / env.physics.timestep())
    meanings = getattr(module, "OBSERVATIONS", {})
    return Facts(
        domain=domain,
        task=task,
        wants=_first_line(module.SUITE[task]),
        tags=_tags(domain, task),
        steps="no limit" if limit is None else str(limit),
        time_limit="none" if limit is None else f"{limit * env.control_timestep():g} s",
        control_timestep=f"{env.control_timestep():g} s",
        physics_steps=f"{substeps} of {env.physics.timestep():g} s",
        observations=tuple(_observations(env, meanings)),
        partly=_partly(module.SUITE[task], domain, task),
        actions=tuple(_action(model, number) for number in range(model.nu)),
        joints=tuple(_joint(model, number) for number in range(model.njnt)),
        terms=tuple(_terms(env)),
        starts=tuple(getattr(env.task, "STARTS", ())),
        cameras=tuple(model.camera(number).name for number in range(model.ncam)),
        measurements=tuple(_measurements(type(env.physics))),
        kind=type(env.task),
    )


def _first_line(documented: object) -> str:
    """The first paragraph of a docstring on one line; empty without one."""
    text = inspect.getdoc(documented) or ""
    return " ".join(text.partition("\n\n")[0].split())


def _tags(domain: str, task: str) -> tuple[str, ...]:
    return tuple(tag for tag in _TAGS if (domain, task) in getattr(suite, tag.upper()))


def _observations(env: _Environment, meanings: Mapping[str, Any]) -> list[Observation]:
    rows, start = [], 0
    for key, spec in env.observation_spec().items():
        end = start + math.prod(spec.shape)
        meaning, unit = meanings.get(key, ("", ""))
        rows.append(Observation(key, str(tuple(spec.shape)), f"{start}:{end}", unit, meaning))
        start = end
    return rows


def _partly(factory: Callable[..., object], domain: str, task: str) -> tuple[str, ...]:
    if "fully_observable" not in inspect.signature(factory).parameters:
        return ()
    with suite.load(domain, task, {"random": 0, "fully_observable": False}) as env:
        return tuple(env.observation_spec())


def _action(model: mujoco.MjModel, number: int) -> Action:
    actuator = model.actuator(number)
    low, high = actuator.ctrlrange if model.actuator_ctrllimited[number] else (-math.inf, math.inf)
    kind = _kind_of_actuator(model, number)
    targets, is_linear = _targets(model, number)
    force, length = ("N", "m") if is_linear else ("N m", "rad")
    units = {"motor": force, "position": length, "velocity": f"{length}/s"}
    return Action(
        str(number),
        actuator.name,
        kind,
        f"{low:g} to {high:g}",
        f"{actuator.gear[0]:g}",
        units.get(kind, ""),
        ", ".join(targets),
    )


def _kind_of_actuator(model: mujoco.MjModel, number: int) -> str:
    """The meaning of a control: a force, or a target position or velocity."""
    bias = int(model.actuator_biastype[number])
    if int(model.actuator_dyntype[number]) != mujoco.mjtDyn.mjDYN_NONE:
        return "general"
    if bias == _BIAS.mjBIAS_NONE:
        return "motor"
    _, of_position, of_velocity = model.actuator_biasprm[number, :3]
    if bias == _BIAS.mjBIAS_AFFINE and of_position:
        return "position"
    return "velocity" if bias == _BIAS.mjBIAS_AFFINE and of_velocity else "general"


def _targets(model: mujoco.MjModel, number: int) -> tuple[list[str], bool]:
    """The names of what an actuator acts on, and whether along a line (else about an axis)."""
    target, kind = int(model.actuator_trnid[number, 0]), int(model.actuator_trntype[number])
    if kind in (_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT):
        return [model.joint(target).name], _kind_of_joint(model, target)[0] == "slide"
    if kind == _TRN.mjTRN_TENDON:
        start, count = int(model.tendon_adr[target]), int(model.tendon_num[target])
        wrapped = range(start, start + count)
        if all(int(model.wrap_type[i]) == mujoco.mjtWrap.mjWRAP_JOINT for i in wrapped):
            joints = [int(model.wrap_objid[i]) for i in wrapped]
            are_slides = all(_kind_of_joint(model, joint)[0] == "slide" for joint in joints)
            return [model.joint(joint).name for joint in joints], are_slides
        return [model.tendon(target).name], True
    if kind == _TRN.mjTRN_BODY:
        return [model.body(target).name], True
    return [model.site(target).name], True


def _kind_of_joint(model: mujoco.MjModel, number: int) -> tuple[str, int, int]:
    return _KINDS_OF_JOINTS[int(model.jnt_type[number])]


def _joint(model: mujoco.MjModel, number: int) -> Joint:
    kind, positions, velocities = _kind_of_joint(model, number)
    low, high = model.jnt_range[number]
    limits = "none"
    if model.jnt_limited[number]:
        limits = f"{low:g} to {high:g} m"
        if kind != "slide":
            limits = f"{math.degrees(low):.0f} to {math.degrees(high):.0f} degrees"
    return Joint(
        model.joint(number).name,
        kind,
        limits,
        _places(int(model.jnt_qposadr[number]), positions),
        _places(int(model.jnt_dofadr[number]), velocities),
    )


def _places(start: int, count: int) -> str:
    return str(start) if count == 1 else f"{start}:{start + count}"


def _terms(env: _Environment) -> list[Term]:
    """The terms of the reward; none if the task's reward has no terms."""
    try:
        terms = env.task.reward_terms(env.physics)
    except (AttributeError, NotImplementedError):
        return []
    goal = getattr(env.task, "GOAL", ())
    return [Term(name, "yes" if name in goal else "") for name in terms]


def _measurements(kind: type[Physics]) -> list[Measurement]:
    """The public methods that the domain's physics adds to MuJoCo's, in the order of the source."""
    found: dict[str, Measurement] = {}
    for base in reversed(kind.__mro__):
        if not issubclass(base, Physics) or base is Physics:
            continue
        for name, method in vars(base).items():
            if inspect.isfunction(method) and not name.startswith("_"):
                parameters = list(inspect.signature(method).parameters)[1:]
                call = f"{name}({', '.join(parameters)})"
                found[name] = Measurement(call, _first_line(method))
    return list(found.values())
