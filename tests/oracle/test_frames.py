"""Frames equal dm_control's pixel for pixel: RGB, depth and segmentation, from every camera."""

import functools
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.mujoco.furnished import add_box

from . import models, twins
from .drawn_here import DOMAINS as DRAWN_HERE
from .oracle import BOTH, needs_rendering
from .same import assert_same, assert_same_outcome, assert_same_pair
from .twins import or_slow

pytestmark = [pytest.mark.oracle, needs_rendering, pytest.mark.usefixtures("compiled_once")]

# The pictures of domains with looks of their own differ by design.
_MODELS = [task for task in twins.MODELS if task[0] not in DRAWN_HERE]
# Sizes, and colours along an episode, do not depend on the model.
_OF_EVERY_SIZE = (("humanoid", "stand"), ("manipulator", "insert_ball"), ("acrobot", "swingup"))
_SIZE = {"height": 90, "width": 120}
_STEPS = 15  # into an episode
_KINDS: dict[str, dict[str, bool]] = {
    "RGB": {},
    "depth": {"depth": True},
    "segmentation": {"segmentation": True},
}


@contextmanager
def _played(domain: str, task: str, steps: int = _STEPS) -> Iterator[twins.Twins]:
    """An environment in mid-episode, whose renderers are freed in the end."""
    env = twins.load(domain, task)
    try:
        env.reset()
        env.play(itertools.islice(env.actions("random", 0), steps))
        yield env
    finally:
        env.ours.physics.free()
        env.theirs.physics.free()


@pytest.fixture(scope="module")
def zoo() -> Iterator[list[Any]]:
    """The same model in both packages, which tests draw and do not change."""
    twin = [package("mujoco").Physics.from_xml_string(models.ZOO) for package in BOTH]
    try:
        for physics in twin:
            physics.step(3)
        yield twin
    finally:
        for physics in twin:
            physics.free()


def _assert_same_frames(twin: list[Any], where: str, **kwargs: Any) -> np.ndarray:
    frames = [physics.render(**kwargs) for physics in twin]
    assert_same_pair(frames, f"{where}, render({kwargs})")
    return frames[1]


def _turns_with_a_body(model: Any, camera: int | str) -> bool:
    """Whether a camera is mounted on a body, such as an eye, and may see nothing but the sky."""
    if not isinstance(camera, int) or camera < 0:
        return False
    is_fixed = model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
    return is_fixed and model.cam_bodyid[camera] > 0


# A model of each kind; pictures of the others are slow, and part of `make test-exactness`.
# Those of the representative tasks are compared in tests/mujoco/test_camera_beside_dm_control.py.
_DRAWN = {*_OF_EVERY_SIZE, ("ball_in_cup", "catch"), ("fish", "upright"), ("cartpole", "balance")}

# The meshes of dm_control's dog are not part of this package, which draws its collision geoms.
_DRAWN_ALIKE = [task for task in twins.TASKS if task[0] != "dog"]


# What else a start writes, such as the place of a target, is compared in test_variants.py.
@pytest.mark.parametrize(("domain", "task"), or_slow(_DRAWN_ALIKE, _DRAWN))
def test_frames_are_the_same(domain: str, task: str) -> None:
    # One environment for all comparisons: making OpenGL's contexts takes longer than ten frames.
    with _played(domain, task, steps=0) as env:
        _compare_first_frames(env)
        if (domain, task) in _MODELS:
            _compare_frames_from_every_camera(env, (domain, task) in _OF_EVERY_SIZE)
        if (domain, task) == _OF_EVERY_SIZE[0]:
            _compare_frames_of_default_and_odd_sizes(env)
        if (domain, task) in _OF_EVERY_SIZE:
            _compare_frames_along_an_episode_with_reward_colours(env)


def test_the_models_are_those_of_tasks_with_frames() -> None:
    assert set(_OF_EVERY_SIZE) < _DRAWN < set(_MODELS) < set(_DRAWN_ALIKE)


def _twin(env: twins.Twins) -> list[Any]:
    return [env.ours.physics, env.theirs.physics]


def _compare_first_frames(env: twins.Twins) -> None:
    first = _assert_same_frames(_twin(env), env.where, camera_id=0, **_SIZE)
    assert np.ptp(first) > 0, f"{env.where}: the camera sees nothing"
    env.play(itertools.islice(env.actions("random", 0), 2))
    env.reset()
    _assert_same_frames(_twin(env), f"{env.where}, second reset", camera_id=0, **_SIZE)


def _compare_frames_from_every_camera(env: twins.Twins, of_every_kind: bool) -> None:
    """Compares colours from each camera, and depth and segmentation, in turn unless of every kind.

    What of a model is in a picture does not depend on its kind.
    """
    env.play(itertools.islice(env.actions("random", 0), _STEPS))
    model = env.theirs.physics.model
    cameras = [-1, *range(model.ncam), model.id2name(0, "camera")]
    in_turn = itertools.cycle(["depth", "segmentation"])
    for camera, kind in [
        (camera, kind)
        for camera in cameras
        for kind in (_KINDS if of_every_kind else ("RGB", next(in_turn)))
    ]:
        kwargs = {"camera_id": camera, **_SIZE, **_KINDS[kind]}
        frame = _assert_same_frames(_twin(env), env.where, **kwargs)
        sees_sky = kind == "segmentation" and _turns_with_a_body(model, camera)
        assert sees_sky or np.ptp(frame) > 0, f"{env.where}: camera {camera} sees nothing"


def _compare_frames_of_default_and_odd_sizes(env: twins.Twins) -> None:
    _assert_same_frames(_twin(env), env.where)
    _assert_same_frames(_twin(env), env.where, height=480, width=640)
    for height, width in [(1, 1), (84, 84), (33, 71)]:
        for kind in _KINDS.values():
            _assert_same_frames(_twin(env), env.where, height=height, width=width, **kind)


def _compare_frames_along_an_episode_with_reward_colours(env: twins.Twins) -> None:
    for one in (env.ours, env.theirs):
        one.task.visualize_reward = True
    env.reset()
    for action in itertools.islice(env.actions("bang-bang", 1), 5):
        env.step(action)
        _assert_same_frames(_twin(env), f"{env.where}, reward colours", camera_id=0, **_SIZE)
    env.reset()
    _assert_same_frames(_twin(env), f"{env.where}, reward colours", camera_id=0, **_SIZE)


_OPTIONS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "wireframe": lambda mujoco: {"render_flag_overrides": {"wireframe": True}},
    "no shadow or sky": lambda mujoco: {"render_flag_overrides": {"shadow": 0, "skybox": False}},
    "flag by its enum": lambda mujoco: {"render_flag_overrides": {_WIREFRAME: True}},
    "transparent": lambda mujoco: {"scene_option": _transparent(mujoco)},
    "one overlay": lambda mujoco: {"overlays": [mujoco.TextOverlay("Title", "Body")]},
    "three overlays": lambda mujoco: {"overlays": _overlays(mujoco)},
    "a geom more": lambda mujoco: {"scene_callback": add_box},
}
_WIREFRAME = mujoco.mjtRndFlag.mjRND_WIREFRAME


def _transparent(package: Any) -> Any:
    option = package.wrapper.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    option.flags[mujoco.mjtVisFlag.mjVIS_JOINT] = True
    option.frame = mujoco.mjtFrame.mjFRAME_GEOM
    option.sitegroup[:] = 1
    return option


def _overlays(package: Any) -> list[Any]:
    return [
        package.TextOverlay(title="1", body="2", style="big", position="bottom right"),
        package.TextOverlay(title="3", style="shadow", position="top right"),
        package.TextOverlay(body="a\nb", position="bottom left"),
    ]


@pytest.mark.parametrize("option", _OPTIONS)
def test_frames_with_options_are_the_same(zoo: list[Any], option: str) -> None:
    plain = _assert_same_frames(zoo, "zoo", **_SIZE)
    frames = [
        physics.render(**_SIZE, **_OPTIONS[option](package("mujoco")))
        for package, physics in zip(BOTH, zoo, strict=True)
    ]
    assert_same_pair(frames, option)
    assert not np.array_equal(frames[1], plain), f"{option} changes nothing"
    # An option holds for one frame.
    _assert_same_frames(zoo, f"after {option}", **_SIZE)


def test_segmentation_with_frames_of_reference_is_the_same(zoo: list[Any]) -> None:
    frames = [
        physics.render(segmentation=True, scene_option=_transparent(package("mujoco")), **_SIZE)
        for package, physics in zip(BOTH, zoo, strict=True)
    ]
    assert_same_pair(frames, "segmentation")


_REFUSED: list[dict[str, Any]] = [
    {"depth": True, "segmentation": True},
    {"depth": True, "render_flag_overrides": {"wireframe": True}},
    {"segmentation": True, "overlays": "TextOverlay"},
    {"camera_id": -2},
    {"camera_id": 99},
    {"camera_id": "no such camera"},
    {"height": 100_000},
    {"width": 100_000},
]


@pytest.mark.parametrize("kwargs", _REFUSED)
def test_incompatible_arguments_are_refused_alike(zoo: list[Any], kwargs: dict[str, Any]) -> None:
    calls = []
    for package, physics in zip(BOTH, zoo, strict=True):
        overlays = [package("mujoco").TextOverlay()]
        arguments = kwargs | ({"overlays": overlays} if "overlays" in kwargs else {})
        calls.append(functools.partial(physics.render, **arguments))
    assert assert_same_outcome(calls, f"render({kwargs})") is not None


@pytest.mark.parametrize("camera_id", [-1, 0, "fixed", 1])
def test_cameras_give_the_same(zoo: list[Any], camera_id: Any) -> None:
    cameras = [
        package("mujoco").Camera(physics, 60, 80, camera_id=camera_id)
        for package, physics in zip(BOTH, zoo, strict=True)
    ]
    for kind in _KINDS.values():
        assert_same_pair((camera.render(**kind).copy() for camera in cameras), f"{kind}")
    for part in ("image", "focal", "rotation", "translation"):
        assert_same_pair((getattr(camera.matrices(), part) for camera in cameras), part)
    assert_same_pair((camera.matrix for camera in cameras), "matrix")
    for query in ("height", "width"):
        assert_same_pair((getattr(camera, query) for camera in cameras), query)
    for place in itertools.product((0.1, 0.5, 0.9), repeat=2):
        ours, theirs = (camera.select(place) for camera in cameras)
        assert ours._fields == theirs._fields
        for field, mine, yours in zip(ours._fields, ours, theirs, strict=True):
            assert_same(mine, yours, f"select({place}).{field}")


def test_a_camera_keeps_its_own_options(zoo: list[Any]) -> None:
    cameras = [
        package("mujoco").Camera(physics, 60, 80)
        for package, physics in zip(BOTH, zoo, strict=True)
    ]
    for camera in cameras:
        camera.option.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
        camera.scene.flags[_WIREFRAME] = True
    assert_same_pair((camera.render().copy() for camera in cameras), "options of the camera")
    _assert_same_frames(zoo, "options of one camera are not another's", **_SIZE)


def test_a_movable_camera_sees_the_same_from_each_pose(zoo: list[Any]) -> None:
    poses = [([0, 0, 0.5], 2.0, 30, -20), ([0.3, -0.2, 0.1], 4, -100, -60)]
    cameras = [
        package("mujoco").MovableCamera(physics, 60, 80)
        for package, physics in zip(BOTH, zoo, strict=True)
    ]
    for pose in (None, *poses):
        for camera in cameras:
            if pose is not None:
                camera.set_pose(*pose)
        ours, theirs = (camera.get_pose() for camera in cameras)
        assert ours._fields == theirs._fields
        for field, mine, yours in zip(ours._fields, ours, theirs, strict=True):
            assert_same(mine, yours, f"pose.{field}")
        assert_same_pair((camera.render().copy() for camera in cameras), f"{pose}")


def test_frames_after_the_model_was_changed_are_the_same() -> None:
    with _played("manipulator", "bring_ball") as env:
        twin = [env.ours.physics, env.theirs.physics]
        _assert_same_frames(twin, "before", **_SIZE)
        for physics in twin:
            physics.named.model.geom_size["ball"] = 0.1
            physics.named.model.mat_rgba["self"] = [0, 1, 0, 1]
            physics.named.model.cam_pos[0] += 0.1
            physics.model.vis.headlight.ambient[:] = 0.9
            physics.forward()
        _assert_same_frames(twin, "after", camera_id=0, **_SIZE)


def test_frames_of_a_copy_and_after_a_reload_are_the_same() -> None:
    with _played("stacker", "stack_4") as env:
        copies = [physics.copy() for physics in (env.ours.physics, env.theirs.physics)]
        try:
            _assert_same_frames(copies, "copy", **_SIZE)
            for physics in copies:
                physics.reload_from_xml_string(models.ZOO)
            _assert_same_frames(copies, "reloaded", **_SIZE)
        finally:
            for physics in copies:
                physics.free()
