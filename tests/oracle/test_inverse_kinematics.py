"""`utils.inverse_kinematics` finds dm_control's joint positions, step by step."""

import functools
import inspect
from typing import Any

import numpy as np
import pytest

from . import models
from .oracle import BOTH, ours, theirs
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_NAME = "utils.inverse_kinematics"

_HINGES = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body><joint name="pan" axis="0 0 1"/><geom size=".05"/>
      <body pos="0 0 .2"><joint name="shoulder" axis="0 1 0"/><geom size=".05"/>
        <body pos=".3 0 0"><joint name="elbow" axis="0 1 0" range="-2 2" limited="true"/>
          <geom size=".05"/>
          <body pos=".3 0 0">
            <joint name="roll" axis="1 0 0"/><joint name="pitch" axis="0 1 0"/>
            <joint name="yaw" axis="0 0 1"/><geom size=".05"/>
            <site name="tip" pos=".1 0 0" euler=".3 .2 .1"/>
          </body>
        </body>
      </body>
    </body>
    <site name="base" pos=".1 .2 .3"/>
  </worldbody>
</mujoco>
"""
_BALLS = """
<mujoco>
  <worldbody>
    <body><joint name="hip" type="ball"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
      <body pos=".2 0 0"><joint name="knee" type="ball"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
        <site name="tip" pos=".2 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
_MODELS = {
    "hinges": (_HINGES, "tip", ["pan", "shoulder", "elbow", "roll", "pitch", "yaw"]),
    "ball joints": (_BALLS, "tip", ["hip", "knee"]),
    "every joint": (models.ZOO, "grip", ["swivel", "wrist", "box_root", "rail"]),
    "a free body": (models.ZOO, "box_top", ["box_root"]),
    "a fixed site": (_HINGES, "base", ["pan", "shoulder"]),
}
every_model = pytest.mark.parametrize("model", _MODELS)


@functools.cache
def _physics(model: str) -> tuple[Any, Any]:
    first, second = (
        package("mujoco").Physics.from_xml_string(_MODELS[model][0]) for package in BOTH
    )
    return first, second


def _agree(model: str, seed: int = 0, **kwargs: Any) -> Exception | None:
    """Compares a search from a random start; the error that ours raised."""
    both = _physics(model)
    start = np.random.RandomState(seed).uniform(-1, 1, both[0].model.nq)
    for physics in both:
        with physics.reset_context():
            physics.data.qpos[:] = start
    arguments = {"site_name": _MODELS[model][1], **kwargs}
    with np.errstate(all="ignore"):
        error = assert_same_outcome(
            [
                functools.partial(_found, package(_NAME), physics, arguments)
                for package, physics in zip(BOTH, both, strict=True)
            ],
            f"{model}, seed {seed}, {kwargs}",
        )
    for field in ("qpos", "qvel", "xpos", "site_xpos", "site_xmat"):
        assert_same_pair([getattr(physics.data, field).copy() for physics in both], field)
    return error


def _found(module: Any, physics: Any, arguments: dict[str, Any]) -> tuple[Any, ...]:
    result = module.qpos_from_site_pose(physics, **arguments)
    assert type(result).__name__ == "IKResult"
    is_live = np.shares_memory(result.qpos, physics.data.qpos)
    return (result.qpos.copy(), *result[1:], result._fields, is_live)


def _choice(random: np.random.RandomState, *options: Any) -> Any:
    return options[random.randint(len(options))]


def _target(random: np.random.RandomState) -> dict[str, Any]:
    """A position, an orientation or both, in one of the forms that programs use."""
    pos = random.uniform(-0.6, 0.6, 3) * _choice(random, 1, 1, 10, 0)
    quat = random.normal(size=4)
    quat = _choice(random, quat / np.linalg.norm(quat), quat, quat * 0)
    target = {"target_pos": pos, "target_quat": quat}
    target = {
        name: _choice(random, value, value, value.tolist(), tuple(value), value.astype(np.float32))
        for name, value in target.items()
    }
    omitted = _choice(random, "target_pos", "target_quat", None)
    return {name: value for name, value in target.items() if name != omitted}


_OPTIONS: dict[str, list[Any]] = {
    "max_steps": [1, 2, 5, 30, 300],
    "tol": [0.0, 1e-3, -1.0, 1e-8],
    "regularization_strength": [0.0, 1.0, -1.0, 1e-8],
    "regularization_threshold": [0.0, 10.0],
    "progress_thresh": [0.0, 1.0, np.inf, 1e8],
    "max_update_norm": [0.1, 0.01, 0.0],
    "rot_weight": [0.1, 0.0, 5.0],
}


def test_the_public_names_and_arguments_are_the_same() -> None:
    assert set(ours(_NAME).__all__) == {"IKResult", "qpos_from_site_pose", "nullspace_method"}
    assert ours(_NAME).IKResult._fields == theirs(_NAME).IKResult._fields
    for name in ("qpos_from_site_pose", "nullspace_method"):
        parameters = [
            [
                (each.name, each.default)
                for each in inspect.signature(getattr(package(_NAME), name)).parameters.values()
            ]
            for package in BOTH
        ]
        assert parameters[0] == parameters[1], name


@every_model
@pytest.mark.parametrize("inplace", [False, True])
def test_searches_from_random_starts_take_the_same_steps(model: str, inplace: bool) -> None:
    random = np.random.RandomState(0)
    joints = _MODELS[model][2]
    for seed in range(40):
        some = [joint for joint in joints if random.uniform() < 0.7] or joints[:1]
        names = _choice(random, None, some, tuple(some), np.array(some))
        options = {
            name: _choice(random, *values)
            for name, values in _OPTIONS.items()
            if random.uniform() < 0.2
        }
        target = _target(random)
        _agree(model, seed, joint_names=names, inplace=inplace, **target, **options)


def test_targets_in_reach_are_found_and_targets_out_of_reach_are_not() -> None:
    # The comparison above would also pass if both always failed.
    physics = _physics("hinges")[0]
    near, far = (
        ours(_NAME).qpos_from_site_pose(physics, "tip", target_pos=[distance, 0.1, 0.3])
        for distance in (0.4, 40)
    )
    assert near.success
    assert not far.success
    assert_same_pair(
        [
            theirs(_NAME).qpos_from_site_pose(_physics("hinges")[1], "tip", [0.4, 0.1, 0.3]).steps,
            near.steps,
        ],
        "steps",
    )


_POSITIONS: list[Any] = [
    5, 0.5, [1, 2], [], np.ones((1, 3)), np.ones((3, 1)), np.ones((3, 3)), np.ones(4), "abc",
    [None] * 3, np.array([1, 2, 3]), np.full(3, np.nan), np.full(3, np.inf), ["a", "b", "c"], {},
]  # fmt: skip
_ORIENTATIONS: list[Any] = [
    5, [1, 0, 0, 0], (1, 0, 0, 0), np.array([1, 0, 0, 0]), np.ones(3), np.ones(5), np.ones((1, 4)),
    np.ones((4, 1)), "abcd", np.full(4, np.nan), np.zeros(4), np.ones(8)[::2], np.ones((2, 4)), [],
    [1, 0, 0, None], {},
]  # fmt: skip


@pytest.mark.parametrize("inplace", [False, True])
def test_targets_of_other_shapes_and_kinds_have_the_same_outcome(inplace: bool) -> None:
    for target in _POSITIONS:
        _agree("hinges", target_pos=target, inplace=inplace)
        _agree("hinges", target_pos=target, target_quat=np.array([1.0, 0, 0, 0]), inplace=inplace)
    for target in _ORIENTATIONS:
        _agree("hinges", target_quat=target, inplace=inplace)
        _agree("hinges", target_quat=target, target_pos=np.full(3, 0.2), inplace=inplace)
    assert isinstance(_agree("hinges", inplace=inplace), ValueError)


_JOINTS: list[Any] = [
    "pan", 1, {"pan": 1}, {"pan"}, print, slice(0, 2), ["nope"], [], (), np.array([]), [0, 1], [9],
    np.array([True] * 3 + [False] * 3), [None], [""], np.array("pan"), [["pan", "elbow"]],
    np.array([["pan"], ["elbow"]]), ["pan", "pan"], [b"pan"], [1.5],
]  # fmt: skip


@pytest.mark.parametrize("joints", _JOINTS, ids=repr)
@pytest.mark.parametrize("inplace", [False, True])
def test_joints_of_every_kind_have_the_same_outcome(joints: Any, inplace: bool) -> None:
    _agree("hinges", joint_names=joints, target_pos=np.full(3, 0.2), inplace=inplace)


@pytest.mark.parametrize("site_name", ["nope", "", 5])
def test_unknown_sites_are_refused_alike(site_name: Any) -> None:
    assert _agree("hinges", site_name=site_name, target_pos=np.ones(3)) is not None


@pytest.mark.parametrize("max_steps", [0, -1, 1.5, 2.0, None, "3", np.int64(4), True])
def test_numbers_of_steps_of_every_kind_have_the_same_outcome(max_steps: Any) -> None:
    _agree("hinges", target_pos=np.full(3, 0.3), max_steps=max_steps)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.float16, int])
@pytest.mark.parametrize("strength", [0, 0.0, 0.03, 1, -1, 1e-9, np.nan, np.float32(0.1)])
def test_the_nullspace_method_is_the_same_in_every_precision(dtype: type, strength: Any) -> None:
    random = np.random.RandomState(1)
    for rows in (1, 3, 6):
        for columns in (1, 2, 6, 20):
            jacobian = (random.normal(size=(rows, columns)) * 3).astype(dtype)
            deficient = jacobian.copy()
            deficient[-1] = deficient[0]
            delta = random.normal(size=rows) * 3
            deltas = [delta, delta.astype(dtype), delta.tolist(), random.normal(size=(rows, 2))]
            for jac in (jacobian, deficient, jacobian.tolist()):
                for goal in [*deltas, np.ones(rows + 1), None, "a"]:
                    _agree_on_nullspace(jac, goal, strength)
    _agree_on_nullspace(np.full((3, 2), np.nan), np.ones(3), strength)


def _agree_on_nullspace(*args: Any) -> None:
    calls = [functools.partial(package(_NAME).nullspace_method, *args) for package in BOTH]
    assert_same_outcome(calls, f"nullspace_method{args}")


def test_results_are_named_tuples_of_the_same_types() -> None:
    results = [
        package(_NAME).qpos_from_site_pose(physics, "tip", np.full(3, 0.2))
        for package, physics in zip(BOTH, _physics("hinges"), strict=True)
    ]
    assert isinstance(results[0], tuple)
    assert_same(tuple(results[0]), tuple(results[1]), "result")
