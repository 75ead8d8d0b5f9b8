"""The compiled models equal dm_control's in every array, number and name."""

from typing import Any

import mujoco
import pytest

from . import twins
from .oracle import BOTH
from .same import assert_same, assert_same_pair, fields

pytestmark = pytest.mark.oracle

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


def _assert_same_models(ours: Any, theirs: Any, where: str) -> None:
    our_fields, their_fields = dict(fields(ours)), dict(fields(theirs))
    assert list(our_fields) == list(their_fields)
    differences = []
    for name, theirs_value in their_fields.items():
        try:
            assert_same(our_fields[name], theirs_value, name)
        except AssertionError as difference:
            differences.append(str(difference))
    assert not differences, f"{where}: {len(differences)} fields differ:\n" + "\n".join(differences)


def _assert_same_names(ours: Any, theirs: Any, where: str) -> None:
    for kind, size in _OBJECTS.items():
        names = [
            [model.id2name(index, kind) for index in range(getattr(model, size))]
            for model in (ours, theirs)
        ]
        assert_same_pair(names, f"{where}: names of {kind}")
    assert ours.name == theirs.name, where


def test_the_fields_of_all_parts_of_a_model_are_found() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    found = {name for name, _ in fields(model)}
    expected = {"nq", "body_pos", "names", "opt.timestep", "opt.gravity", "stat.extent"}
    assert expected | {"vis.global_.offwidth", "vis.headlight.ambient"} <= found


@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_a_loaded_model_is_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    models = env.ours.physics.model, env.theirs.physics.model
    _assert_same_models(models[0].ptr, models[1].ptr, env.where)
    _assert_same_names(models[0], models[1], env.where)


_MAKE_MODEL = [
    ("manipulator", {"use_peg": use_peg, "insert": insert})
    for use_peg in (False, True)
    for insert in (False, True)
] + [("stacker", {"n_boxes": n_boxes}) for n_boxes in (1, 2, 3, 4)]


@pytest.mark.parametrize(("domain", "kwargs"), _MAKE_MODEL)
def test_a_made_model_compiles_to_the_same(domain: str, kwargs: dict[str, Any]) -> None:
    models = []
    for package in BOTH:
        made = getattr(package("suite"), domain).make_model(**kwargs)
        models.append(package("mujoco").wrapper.MjModel.from_xml_string(*made))
    _assert_same_models(models[0].ptr, models[1].ptr, f"{domain}.make_model({kwargs})")
    _assert_same_names(models[0], models[1], f"{domain}.make_model({kwargs})")


def test_the_humanoid_read_from_its_file_compiles_to_the_same() -> None:
    models = []
    for package in BOTH:
        made = package("suite").humanoid.get_model_and_assets()
        models.append(package("mujoco").wrapper.MjModel.from_xml_string(*made))
    _assert_same_models(models[0].ptr, models[1].ptr, "humanoid.get_model_and_assets()")


_REGISTRY = ["ALL_TASKS", "BENCHMARKING", "EASY", "HARD", "EXTRA", "REWARD_VIZ", "NO_REWARD_VIZ"]


@pytest.mark.parametrize("name", _REGISTRY)
def test_the_registry_holds_the_same_tasks_of_the_domains_that_are_built(name: str) -> None:
    built, whole = (getattr(package("suite"), name) for package in BOTH)
    domains = {domain for domain, _ in twins.TASKS}
    assert_same(built, tuple(task for task in whole if task[0] in domains), name)


@pytest.mark.parametrize("domain", sorted({domain for domain, _ in twins.TASKS}))
def test_a_domain_lists_and_tags_the_same_tasks(domain: str) -> None:
    registries = [getattr(package("suite"), domain).SUITE for package in BOTH]
    assert_same_pair((list(registry) for registry in registries), f"{domain}: tasks")
    assert_same_pair((registry.tags() for registry in registries), f"{domain}: tags")
    for tag in registries[1].tags():
        assert_same_pair(
            (list(registry.tagged(tag)) for registry in registries), f"{domain}: {tag}"
        )
    by_domain = [package("suite").TASKS_BY_DOMAIN[domain] for package in BOTH]
    assert_same_pair(by_domain, f"{domain}: TASKS_BY_DOMAIN")
