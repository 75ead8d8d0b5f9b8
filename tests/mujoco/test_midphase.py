"""Contacts with the world's planes, with and without the bounding volume tree of the world."""

import copy

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import midphase

_WITHOUT = mujoco.mjtDisableBit.mjDSBL_MIDPHASE.value
_BALL = '<body pos="0 0 2"><freejoint/><geom size=".1"/><geom size=".1" pos=".3 0 0"/></body>'
_HEIGHTS = [0.0, 0.1, 0.2, 0.3, 0.55, 0.7, 0.9, 1.0, -0.25]  # of which a half are rounded down


def _model(world: str, body: str = _BALL) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}{body}</worldbody></mujoco>")


def _floor(height: float) -> str:
    return f'<geom type="plane" size="1 1 1" pos="0 0 {height}"/>'


def _contacts(model: mujoco.MjModel, data: mujoco.MjData, disabled: int) -> list:
    model.opt.disableflags = disabled
    mujoco.mj_fwdPosition(model, data)
    contacts = data.contact
    return [contacts.geom.tolist(), contacts.dist.tolist(), contacts.pos.tolist()]


def _differs(height: float) -> bool:
    """Whether light contacts with a floor differ without the midphase."""
    random = np.random.default_rng(0)
    for _ in range(200):
        radius = random.uniform(0.05, 0.1)
        model = _model(_floor(height), _BALL.replace(".1", str(radius)))
        data = mujoco.MjData(model)
        data.qpos[2] = height + radius - 10 ** random.uniform(-12, -8)
        if _contacts(model, data, 0) != _contacts(model, data, _WITHOUT):
            return True
    return False


@pytest.mark.parametrize("height", _HEIGHTS)
def test_it_is_needless_where_light_touches_of_the_floor_are_the_same(height: float) -> None:
    model = _model(_floor(height))
    assert midphase.is_needless(model) == (not _differs(height))


def test_floors_are_of_both_kinds() -> None:
    found = {midphase.is_needless(_model(_floor(height))) for height in _HEIGHTS}
    assert found == {True, False}


@pytest.mark.parametrize(
    ("world", "body"),
    [
        ("", _BALL),
        (_floor(0) + '<geom type="box" size="1 1 1" pos="3 0 0"/>', _BALL),
        (_floor(0) * 9, _BALL),
        (_floor(0), _BALL.replace('size=".1"', 'size=".1" margin=".01"')),
        (_floor(0), _BALL.replace('size=".1"', 'size=".1" gap=".01"')),
    ],
    ids=["no plane", "a box", "many planes", "a margin", "a gap"],
)
def test_it_is_kept_in_other_worlds(world: str, body: str) -> None:
    assert not midphase.is_needless(_model(world, body))


def test_it_is_kept_where_simulations_have_shapes_of_their_own() -> None:
    model = _model(_floor(0))
    assert midphase.is_needless(model, ["geom_friction"])
    assert not midphase.is_needless(model, ["geom_friction", "geom_pos"])


def test_it_is_kept_where_boxes_have_been_left_behind() -> None:
    for field, row in (("geom_size", 2), ("geom_pos", 2), ("body_ipos", 1)):
        model = _model(_floor(0))
        assert midphase.is_needless(model)
        getattr(model, field)[row, 0] += 0.01
        assert not midphase.is_needless(model), field


@pytest.mark.parametrize("kind", ["capsule", "cylinder", "box", "ellipsoid", "sphere"])
def test_boxes_that_hold_their_geoms_are_no_reason_to_keep_it(kind: str) -> None:
    geoms = (
        f'<geom type="{kind}" size=".1 .2 .3" pos=".1 0 .2" euler="{turn} 20 70"/>'
        for turn in (0, 30, 50)
    )
    body = f'<body pos="0 0 2" euler="10 20 30"><freejoint/>{"".join(geoms)}</body>'
    assert midphase.is_needless(_model(_floor(0), body))


# Worlds that keep their trees: nothing touches them, their geoms are moved at starts, or they have
# other geoms than planes.
_WITH_TREES = {"cartpole", "fish", "lqr", "point_mass", "reacher", "swimmer"}
_WITH_TREES |= {"dog:fetch", "quadruped:escape"}


@pytest.mark.parametrize(
    ("domain", "task"),
    [task for task in suite.ALL_TASKS if not {task[0], ":".join(task)} & _WITH_TREES],
)
def test_the_suites_other_worlds_do_without(domain: str, task: str) -> None:
    batch = suite.load_batch(domain, task, 2, num_threads=1, seed=0)
    trees = batch.physics.simulation._official.expand("body_bvhadr")
    np.testing.assert_array_equal(trees[:, 0], -1)
    assert (trees[:, 1:] >= 0).any()
    assert batch.physics.model.body_bvhadr[0] == 0  # what users see is the model
    batch.close()


@pytest.mark.parametrize(
    ("domain", "task", "prop"),
    [
        ("manipulator", "bring_ball", "ball"),
        ("manipulator", "insert_peg", "peg"),
        ("stacker", "stack_2", "box0"),
    ],
)
def test_light_touches_of_floor_and_walls_are_the_same(domain: str, task: str, prop: str) -> None:
    env = suite.load(domain, task, task_kwargs={"random": 0})
    env.reset()
    model, random = copy.copy(env.physics.model._official), np.random.default_rng(0)
    data, height = mujoco.MjData(model), model.joint(f"{prop}_z").qposadr
    geom, touches = model.body(prop).geomadr[0], 0
    for plane in ("floor", "wall1", "wall2"):
        place = model.geom(plane).id
        for _ in range(200):
            for axis, value in zip("xzy", random.uniform([-0.6, 1, -3], [0.6, 1, 3]), strict=True):
                data.joint(f"{prop}_{axis}").qpos = value
            mujoco.mj_fwdPosition(model, data)
            above = mujoco.mj_geomDistance(model, data, place, geom, 9.0, None)
            depth = 10 ** random.uniform(-12, -6)
            data.qpos[height] -= (above + depth) / data.geom_xmat[place][8]
            found = _contacts(model, data, 0)
            assert found == _contacts(model, data, _WITHOUT)
            touches += [place, geom] in found[0]
    assert touches > 500
    env.close()
