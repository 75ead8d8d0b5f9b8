"""Named indexing: the same axes, results for every kind of key, and kinds of error."""

import functools
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from limberjack.mujoco.read_only import Checked

from . import models, twins
from .oracle import BOTH, REMOVED_FIELDS
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

# dm_control goes through the rows of a mask or of a printed field one by one; a texture has
# millions.
_MANY_ROWS = 1000

_MODELS = [
    "humanoid:walk",
    "manipulator:insert_peg",
    "stacker:stack_4",
    "zoo",
]
every_model = pytest.mark.parametrize("name", _MODELS)
both_structs = pytest.mark.parametrize("struct", ["model", "data"])


def _twin_physics(name: str) -> list[Any]:
    """Physics of both packages after the same few steps, so that most fields are not zero."""
    if name == "zoo":
        twin_physics = [package("mujoco").Physics.from_xml_string(models.ZOO) for package in BOTH]
    else:
        domain, task = name.split(":")
        env = twins.load(domain, task)
        env.reset()
        twin_physics = [env.ours.physics, env.theirs.physics]
    for physics in twin_physics:
        physics.data.ctrl[:] = np.linspace(-0.4, 0.4, physics.model.nu)
        physics.step(5)
        physics.forward()
    return twin_physics


def _indexers(name: str, struct: str) -> Iterator[tuple[str, Any, Any]]:
    """Name, our indexer and dm_control's indexer of every field that dm_control has."""
    # dm_control's indexers do not keep their physics alive: these two names do.
    ours, theirs = _twin_physics(name)
    our_struct, their_struct = getattr(ours.named, struct), getattr(theirs.named, struct)
    for field, their_indexer in their_struct._asdict().items():
        yield field, getattr(our_struct, field), their_indexer


def _row_keys(axis: Any, size: int) -> list[Any]:
    names = [name for name in _names(axis) if name]
    keys: list[Any] = [slice(None), slice(None, None, 2), slice(None, None, -1), slice(1, 3)]
    keys += [0, -1, np.int64(0), [0], [-1, 0], np.array([0, 0]), size, -size - 1]
    keys += [np.array([[0], [-1]]), [[0, -1]]]
    if 0 < size <= _MANY_ROWS:
        keys += [np.arange(size) % 2 == 0, [True] * size]
    keys += names
    if names:
        keys += [names[:1], names[::-1], [names[0], names[-1], names[0]], np.array(names[-3:])]
        keys += [tuple(names[:1])]
        # An element of such an axis is several numbers: dm_control has no rectangles of them.
        if type(axis).__name__ != "RaggedNamedAxis":
            keys += [np.array(names[:2]).reshape(-1, 1), [[names[0]], [names[-1]]]]
    return keys


def _column_keys(names: list[str], size: int) -> list[Any]:
    keys: list[Any] = [0, -1, slice(None), slice(0, 2), [0], [-1, 0], size]
    if names:
        keys += [names[0], names[-1], names[::-1], [names[0]], np.array(names[:2])]
    return keys


def _bad_keys() -> list[Any]:
    bad: list[Any] = ["no such name", "", b"", None, Ellipsis, 1.5, "0", b"box"]
    bad += [["no such name"], [""], [None], [Ellipsis], np.array(["no such name"])]
    bad += [(0, 0, 0, 0), (0, "no such name"), (0, ""), (0, None), (0, Ellipsis), ("no such", 0)]
    return bad


def _keys(indexer: Any) -> list[Any]:
    """Keys of every kind for a field, made of the names that dm_control's axes have."""
    shape = indexer.shape
    rows = _row_keys(indexer.axes.row, shape[0])
    if len(shape) == 1:
        return rows + _bad_keys()
    columns = _column_keys(_names(indexer.axes.col), shape[1])
    # Every row key with one column key and the other way round, not all pairs.
    pairs = [(row, columns[index % len(columns)]) for index, row in enumerate(rows)]
    pairs += [(rows[index % len(rows)], column) for index, column in enumerate(columns)]
    pairs += [([[0], [-1]], column) for column in columns if isinstance(column, list)]
    return rows + pairs + _bad_keys()


def _names(axis: Any) -> list[str]:
    """The axis's names; empty if no object is named or there are no objects."""
    return list(getattr(axis, "names", []))


@every_model
@both_structs
def test_the_axes_of_every_field_have_the_same_names(name: str, struct: str) -> None:
    differences = []
    for field, ours, theirs in _indexers(name, struct):
        assert ours.axes._fields == theirs.axes._fields
        for side, our_axis, their_axis in zip(
            ("rows", "columns"), ours.axes, theirs.axes, strict=True
        ):
            assert (our_axis is None) == (their_axis is None), f"{name}: {struct}.{field}, {side}"
            if _names(our_axis) != _names(their_axis):
                names = f"{_names(our_axis)}, dm_control has {_names(their_axis)}"
                differences.append(f"{name}: {struct}.{field}, {side}: {names}")
    assert not differences, "\n".join(differences)


def _ordinary(indexer: Any, key: Any) -> Any:
    """An element of a field; a view of ours whose writes are checked as an ordinary array."""
    value = indexer[key]
    is_checked = isinstance(value, Checked) and not value.flags.writeable
    return value.view(np.ndarray) if is_checked else value


@every_model
@both_structs
def test_every_field_gives_the_same_for_keys_of_every_kind(name: str, struct: str) -> None:
    differences = []
    for field, ours, theirs in _indexers(name, struct):
        assert ours.shape == theirs.shape, f"{name}: {field}"
        for key in _keys(theirs):
            try:
                assert_same_outcome(
                    [functools.partial(_ordinary, one, key) for one in (ours, theirs)],
                    f"{name}: {struct}.{field}[{key!r}]",
                )
            except AssertionError as difference:
                differences.append(str(difference))
    assert not differences, "\n".join([*differences[:20], f"{len(differences)} differences"])


@pytest.mark.parametrize("name", ["humanoid:walk", "zoo"])
@both_structs
def test_views_of_live_memory_are_views_here_too(name: str, struct: str) -> None:
    twin = _twin_physics(name)
    for field, their_indexer in getattr(twin[1].named, struct)._asdict().items():
        our_indexer = getattr(getattr(twin[0].named, struct), field)
        ours, theirs = (getattr(getattr(physics, struct), field) for physics in twin)
        for key in [slice(None), 0, *_names(their_indexer.axes.row)[:3]]:
            if not theirs.size or key == "":
                continue
            shared = np.shares_memory(their_indexer[key], theirs)
            assert np.shares_memory(our_indexer[key], ours) == shared, f"{name}: {field}[{key!r}]"


@pytest.mark.parametrize("name", ["humanoid:walk", "zoo"])
@both_structs
def test_assignment_by_keys_of_every_kind_writes_the_same(name: str, struct: str) -> None:
    twin = _twin_physics(name)
    arrays = [getattr(physics, struct) for physics in twin]
    for field, their_indexer in getattr(twin[1].named, struct)._asdict().items():
        our_indexer = getattr(getattr(twin[0].named, struct), field)
        # Integers may be addresses that MuJoCo follows.
        if not np.issubdtype(their_indexer.dtype, np.floating):
            continue
        for key in _keys(their_indexer):
            where = f"{name}: {struct}.{field}[{key!r}] = ..."
            value = _value_for(their_indexer, key)
            assert_same_outcome(
                [
                    functools.partial(operator.setitem, one, key, value)
                    for one in (our_indexer, their_indexer)
                ],
                where,
            )
            assert_same_pair((getattr(array, field) for array in arrays), where)


def _value_for(indexer: Any, key: Any) -> Any:
    try:
        found = indexer[key]
    except (IndexError, KeyError, ValueError):
        return 0.5
    return np.random.RandomState(found.size).uniform(0.1, 1, found.shape)


@pytest.mark.parametrize("name", ["humanoid:walk", "manipulator:insert_peg", "zoo"])
def test_cached_keys_read_the_current_values(name: str) -> None:
    twin = _twin_physics(name)
    fields = ("qpos", "qvel", "xpos", "xmat", "geom_xpos", "site_xpos", "sensordata", "ctrl")
    for _ in range(3):
        for physics in twin:
            physics.data.ctrl[:] += 0.1
            physics.step(3)
        for field in fields:
            ours, theirs = (getattr(physics.named.data, field) for physics in twin)
            for key in _keys(theirs):
                calls = [functools.partial(operator.getitem, one, key) for one in (ours, theirs)]
                assert_same_outcome(calls, f"{name}: {field}[{key!r}]")


@both_structs
def test_a_value_of_the_wrong_shape_is_refused_alike(struct: str) -> None:
    twin = _twin_physics("zoo")
    field = {"model": "body_pos", "data": "xpos"}[struct]
    ours, theirs = (getattr(getattr(physics.named, struct), field) for physics in twin)
    for key, value in [("cart", [1, 2]), ("cart", "text"), (["cart", "hand"], np.zeros((3, 3)))]:
        error = assert_same_outcome(
            [functools.partial(operator.setitem, one, key, value) for one in (ours, theirs)],
            f"{field}[{key!r}] = {value!r}",
        )
        assert error is not None


@pytest.mark.parametrize(
    ("field", "key"),
    [("qpos", "box_root"), ("sensordata", "acceleration"), ("xmat", "hand"), ("qvel", "swivel")],
)
def test_assignment_to_what_indexing_returned_writes_the_same(field: str, key: str) -> None:
    twin = _twin_physics("zoo")
    for physics in twin:
        indexer = getattr(physics.named.data, field)
        indexer[key][1:] = 0.25
        indexer[key][[0, 2]] += 1.5
    assert_same_pair((getattr(physics.data, field) for physics in twin), field)


@every_model
@both_structs
def test_every_field_can_be_printed_and_listed(name: str, struct: str) -> None:
    twin = _twin_physics(name)
    ours, theirs = (getattr(physics.named, struct) for physics in twin)
    assert set(theirs._asdict()) <= set(ours._asdict()) <= set(dir(ours))
    for field, indexer in theirs._asdict().items():
        if indexer.shape[0] <= _MANY_ROWS:
            assert field in repr(getattr(ours, field))
        assert {"copy", "shape", "axes"} <= set(dir(getattr(ours, field)))


@both_structs
def test_an_unknown_field_is_an_attribute_error_for_both(struct: str) -> None:
    for physics in _twin_physics("zoo"):
        for field in ("no_such_field", *REMOVED_FIELDS[:1]):
            with pytest.raises(AttributeError):
                getattr(getattr(physics.named, struct), field)


def test_a_named_view_shows_the_new_model_after_a_reload() -> None:
    twin = _twin_physics("humanoid:walk")
    for physics in twin:
        physics.reload_from_xml_string(models.ZOO)
    ours, theirs = (physics.named.data.qpos["swivel"] for physics in twin)
    assert_same(ours, theirs, "qpos['swivel']")


def test_a_named_write_to_one_model_leaves_other_environments_alone() -> None:
    first, second = (twins.load("manipulator", "bring_ball") for _ in range(2))
    for env in (first.ours, first.theirs):
        env.physics.named.model.geom_size["ball"] = 0.05
        env.physics.named.model.body_mass["ball"] *= 3
        env.physics.model.opt.gravity[2] = -5
    for env in (first, second):
        env.reset()
        env.play([np.full(5, 0.3)] * 30)
        env.assert_same_physics("model.geom_size", "model.body_mass", "model.opt.gravity")


@pytest.mark.parametrize(
    ("field", "key"),
    [
        ("mat_texid", 0),
        ("geom_condim", slice(None)),
        ("cam_resolution", 0),
        ("geom_matid", slice(None, None, 2)),
    ],
)
def test_writes_to_views_of_integers_of_a_model_are_the_same(field: str, key: Any) -> None:
    twin = _twin_physics("humanoid:walk")
    for physics in twin:
        indexer = getattr(physics.named.model, field)
        indexer[key] *= 1
        indexer[key][:1] = 1
    assert_same_pair((np.array(getattr(p.model, field)) for p in twin), field)
