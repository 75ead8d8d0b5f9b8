"""The compiled models equal dm_control's in every array, number and name."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco.fingerprint import fingerprint
from tests.small_sky import small_sky

from . import twins
from .drawn_here import DOMAINS, NOT_COMPARED, compared_fields, compared_names
from .oracle import BOTH, ours
from .same import assert_same, assert_same_pair, fields

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

_OBJECTS = {
    "body": "nbody",
    "joint": "njnt",
    "geom": "ngeom",
    "site": "nsite",
    "camera": "ncam",
    "light": "nlight",
    "texture": "ntex",
    "material": "nmat",
    "tendon": "ntendon",
    "equality": "neq",
    "actuator": "nactuator",
    "sensor": "nsensor",
    "key": "nkey",
    "numeric": "nnumeric",
    "text": "ntext",
    "mesh": "nmesh",
    "pair": "npair",
    "exclude": "nexclude",
}


def _assert_same_models(domain: str, ours: Any, theirs: Any, where: str) -> None:
    differences = []
    for name, our_value, their_value in compared_fields(domain, ours, theirs):
        try:
            assert_same(our_value, their_value, name)
        except AssertionError as difference:
            differences.append(str(difference))
    assert not differences, f"{where}: {len(differences)} fields differ:\n" + "\n".join(differences)


def _assert_same_names(domain: str, ours: Any, theirs: Any, where: str) -> None:
    for kind, size in _OBJECTS.items():
        names = [
            [model.id2name(index, kind) for index in range(getattr(model, size))]
            for model in (ours, theirs)
        ]
        compared = compared_names(domain, kind, (ours.ptr, theirs.ptr), names)
        assert_same_pair(compared, f"{where}: names of {kind}")
    assert ours.name == theirs.name, where


def test_the_fields_of_all_parts_of_a_model_are_found() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    found = {name for name, _ in fields(model)}
    expected = {"nq", "body_pos", "names", "opt.timestep", "opt.gravity", "stat.extent"}
    assert expected | {"vis.global_.offwidth", "vis.headlight.ambient"} <= found


@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_a_loaded_model_and_its_task_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    for name, value in vars(env.theirs.task).items():  # the private ones too
        if isinstance(value, bool | int | float | str | list):
            here = getattr(env.ours.task, name)
            assert here == value, f"{name}: {here!r}, {value!r}"
    models = env.ours.physics.model, env.theirs.physics.model
    _assert_same_models(domain, models[0].ptr, models[1].ptr, env.where)
    _assert_same_names(domain, models[0], models[1], env.where)


def test_the_tasks_with_one_model_are_known() -> None:
    sources: dict[str, tuple[str, str]] = {}
    with small_sky():
        for task in twins.TASKS:
            model = ours("suite").load(*task, {"random": 0}).physics.model._official
            assert sources.setdefault(fingerprint(model), task) == twins.MODEL_OF[task]


@pytest.mark.parametrize("domain", DOMAINS)
def test_every_field_that_is_not_compared_differs(domain: str) -> None:
    task = next(name for of, name in twins.TASKS if of == domain)
    env = twins.load(domain, task)
    both = [dict(fields(one.physics.model.ptr)) for one in (env.ours, env.theirs)]
    for name in NOT_COMPARED:
        found = [field for field in both[1] if field == name or field.startswith(name[:-1])]
        different = [
            f for f in found if np.asarray(both[0][f]).tobytes() != np.asarray(both[1][f]).tobytes()
        ]
        assert different, name


_BOOLEANS = (False, True)
# Functions of the domains that make a model, and their arguments.
_MAKERS: list[tuple[str, str, dict[str, Any]]] = [
    ("dog", "get_model_and_assets", {}),
    ("dog", "get_model_and_assets", {"floor_size": 3, "remove_ball": False}),
    ("humanoid", "get_model_and_assets", {}),
    ("humanoid_CMU", "get_model_and_assets", {}),
    *(
        ("manipulator", "make_model", {"use_peg": use_peg, "insert": insert})
        for use_peg in _BOOLEANS
        for insert in _BOOLEANS
    ),
    *(("stacker", "make_model", {"n_boxes": n_boxes}) for n_boxes in (1, 2, 3, 4)),
    *(("cartpole", "get_model_and_assets", {"num_poles": poles}) for poles in (1, 2, 3, 5)),
    *(
        ("lqr", "get_model_and_assets", {"n_bodies": bodies, "n_actuators": n, "random": 0})
        for bodies, n in ((1, 1), (2, 1), (5, 5), (6, 2))
    ),
    *(("swimmer", "get_model_and_assets", {"n_joints": links}) for links in (3, 4, 6, 15)),
    *(
        (
            "quadruped",
            "make_model",
            {"floor_size": size, "terrain": terrain, "rangefinders": rays, "walls_and_ball": ball},
        )
        for size in (None, 7.5)
        for terrain in _BOOLEANS
        for rays in _BOOLEANS
        for ball in _BOOLEANS
    ),
]


@pytest.mark.parametrize(("domain", "maker", "kwargs"), _MAKERS)
def test_a_made_model_compiles_to_the_same(domain: str, maker: str, kwargs: dict[str, Any]) -> None:
    models = []
    for package in BOTH:
        suite = package("suite")
        # A stream for each package, of the same seed.
        streams = {name: np.random.RandomState(kwargs[name]) for name in kwargs if name == "random"}
        made = getattr(getattr(suite, domain), maker)(**kwargs | streams)
        if isinstance(made, bytes):  # without the files that it includes
            made = made, suite.common.ASSETS
        models.append(package("mujoco").wrapper.MjModel.from_xml_string(*made))
    where = f"{domain}.{maker}({kwargs})"
    _assert_same_models(domain, models[0].ptr, models[1].ptr, where)
    _assert_same_names(domain, models[0], models[1], where)
