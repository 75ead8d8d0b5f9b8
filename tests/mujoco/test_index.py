"""Tests of limberjack.mujoco.index and fields: arrays indexed by names."""

import itertools
import pickle
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, fields
from limberjack.mujoco.index import Axes, Axis, FieldIndexer, Names

_XML = """
<mujoco>
  <asset>
    <material name="skin" rgba=".1 .2 .3 .4"/>
  </asset>
  <worldbody>
    <light name="sun"/>
    <camera name="side" pos="0 -3 0"/>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="boat" pos="0 0 2">
      <freejoint name="float"/>
      <geom name="hull" type="box" size=".1 .2 .3"/>
      <site name="bow" pos=".1 0 0"/>
      <body name="mast">
        <joint name="swivel" type="ball"/>
        <geom size=".1" pos=".3 0 0"/>
        <body name="boom"><joint name="yaw"/><geom name="boom" size=".1" pos=".5 0 0"/></body>
      </body>
    </body>
    <body name="buoy" mocap="true" pos="1 2 3"/>
    <body name="anchor" mocap="true"/>
    <body><joint name="rope" type="slide"/><geom name="weight" size=".1"/></body>
  </worldbody>
  <actuator>
    <motor name="turn" joint="yaw"/>
    <general name="pull" joint="rope" dyntype="filter" dynprm="1"/>
    <general name="slow" joint="rope" dyntype="filter" dynprm="2"/>
  </actuator>
  <sensor>
    <gyro name="gyro" site="bow"/>
    <jointpos name="yaw" joint="yaw"/>
  </sensor>
  <custom>
    <numeric name="pair" data="4 5"/>
    <numeric name="single" data="6"/>
  </custom>
  <keyframe><key name="home"/></keyframe>
</mujoco>
"""

# Field, key of names, the same key in numbers.
_KEYS: list[tuple[str, Any, Any]] = [
    ("xpos", "mast", 2),
    ("xpos", ("mast", "z"), (2, 2)),
    ("xpos", ("mast", ["x", "z"]), (2, [0, 2])),
    ("xpos", ["boat", "boom"], [1, 3]),
    ("xpos", (["boat", "boom"], "y"), ([1, 3], 1)),
    ("xpos", (["boat", "boom"], ["x", "y"]), ([1, 3], [0, 1])),
    ("xpos", ([["boat"], ["boom"]], ["x", "z"]), ([[1], [3]], [0, 2])),
    ("xpos", "world", 0),
    ("xmat", ("boat", "zz"), (1, 8)),
    ("xmat", ("boat", ["xx", "yx", "zx"]), (1, [0, 3, 6])),
    ("xquat", ("boat", "qw"), (1, 0)),
    ("qpos", "float", slice(0, 7)),
    ("qpos", "swivel", slice(7, 11)),
    ("qpos", "yaw", slice(11, 12)),
    ("qpos", ["rope", "yaw"], [12, 11]),
    ("qpos", ["yaw", "swivel"], [11, 7, 8, 9, 10]),
    ("qvel", "float", slice(0, 6)),
    ("qvel", ["swivel", "rope"], [6, 7, 8, 10]),
    ("qacc", "rope", slice(10, 11)),
    ("act", "slow", 1),
    ("act", ["slow", "pull"], [1, 0]),
    ("ctrl", "turn", 0),
    ("ctrl", ["slow", "turn"], [2, 0]),
    ("actuator_force", "pull", 1),
    ("sensordata", "gyro", slice(0, 3)),
    ("sensordata", "yaw", slice(3, 4)),
    ("sensordata", ["yaw", "gyro"], [3, 0, 1, 2]),
    ("mocap_pos", ("buoy", "y"), (0, 1)),
    ("mocap_pos", "anchor", 1),
    ("site_xpos", "bow", 0),
    ("cam_xpos", "side", 0),
    ("geom_xpos", ["weight", "boom"], [4, 3]),
    ("xanchor", "swivel", 1),
    ("body_mass", "boat", 1),
    ("geom_size", (["hull", "boom"], 0), ([1, 3], 0)),
    ("geom_rgba", ("hull", "a"), (1, 3)),
    ("mat_rgba", ("skin", ["r", "b"]), (0, [0, 2])),
    ("jnt_range", "yaw", 2),
    ("qpos0", "float", slice(0, 7)),
    ("dof_damping", "swivel", slice(6, 9)),
    ("actuator_gear", ("turn", 0), (0, 0)),
    ("numeric_data", "pair", slice(0, 2)),
    ("numeric_data", ["single", "pair"], [2, 0, 1]),
    ("key_qpos", ("home", "rope"), (0, slice(12, 13))),
    ("cam_pos", ("side", "y"), (0, 1)),
    ("light_dir", ("sun", "z"), (0, 2)),
    # Numbers, slices and masks are NumPy's.
    ("xpos", 1, 1),
    ("xpos", slice(1, 3), slice(1, 3)),
    ("xpos", ("boat", slice(None, None, 2)), (1, slice(None, None, 2))),
    ("xpos", (slice(None), "z"), (slice(None), 2)),
    ("xpos", ([1, 2], "z"), ([1, 2], 2)),
    ("xpos", (-1, -1), (-1, -1)),
    ("xpos", np.array(["boat", "boom"]), [1, 3]),
]
_keys = pytest.mark.parametrize(("name", "key", "numbers"), _KEYS, ids=str)


@pytest.fixture
def physics() -> Physics:
    physics = Physics.from_xml_string(_XML)
    physics.data.qvel[:] = np.linspace(0.1, 1.2, physics.model.nv)
    physics.data.ctrl[:] = [1.0, 2.0, 3.0]
    physics.step(5)
    return physics


def raw(physics: Physics, name: str) -> np.ndarray:
    """The official array."""
    return getattr(physics.data.ptr if hasattr(physics.data, name) else physics.model.ptr, name)


def named(physics: Physics, name: str) -> FieldIndexer:
    view = physics.named.data if hasattr(physics.data, name) else physics.named.model
    return getattr(view, name)


@_keys
def test_names_select_the_same_elements_as_their_numbers(
    physics: Physics, name: str, key: Any, numbers: Any
) -> None:
    expected = raw(physics, name)[numbers]
    for _ in range(2):  # looked up, then remembered
        got = named(physics, name)[key]
        assert type(got) is type(expected)
        assert np.shape(got) == np.shape(expected)
        np.testing.assert_array_equal(got, expected)


@_keys
def test_names_assign_the_same_elements_as_their_numbers(
    physics: Physics, name: str, key: Any, numbers: Any
) -> None:
    expected = raw(physics, name).copy()
    for value in (3, 4):
        new = np.full(np.shape(expected[numbers]), value)
        expected[numbers] = new
        named(physics, name)[key] = new
        np.testing.assert_array_equal(raw(physics, name), expected)
    expected[numbers] = 7
    named(physics, name)[key] = 7
    np.testing.assert_array_equal(raw(physics, name), expected)


@_keys
def test_in_a_batch_names_select_the_same_elements_in_each_row(
    physics: Physics, name: str, key: Any, numbers: Any
) -> None:
    single = named(physics, name)
    one = raw(physics, name)
    stream = np.random.RandomState(0)
    rows = [stream.permutation(100)[: one.size].reshape(one.shape) for _ in range(4)]
    batch = FieldIndexer(name, np.array(rows), single.axes, batch=True)
    for _ in range(2):
        got = batch[key]
        assert got.shape[0] == len(rows)
        for row, values in zip(rows, got, strict=True):
            np.testing.assert_array_equal(values, FieldIndexer(name, row, single.axes)[key])
    expected = np.array(rows)
    for row in expected:
        row[numbers] = -1
    for _ in range(2):
        batch[key] = -1
        np.testing.assert_array_equal(np.asarray(batch), expected)


def _masks(shape: tuple[int, ...]) -> list[Any]:
    """Keys of every kind with booleans for a field of this shape."""
    mask = np.random.default_rng(0).random(shape) < 0.5
    rows = mask.any(axis=-1)
    return [mask, mask.tolist(), rows, rows.tolist(), (rows, "z"), (slice(None), mask[1]), True]


# As many rows as bodies, so that a mask of one axis too many would have a valid shape.
@pytest.mark.parametrize("num_envs", [4, 7])
def test_in_a_batch_masks_select_the_same_elements_in_each_row(
    physics: Physics, num_envs: int
) -> None:
    xpos = named(physics, "xpos")
    rows = np.random.default_rng(1).random((num_envs, *xpos.shape))
    for key in _masks(xpos.shape):
        batch = FieldIndexer("xpos", rows.copy(), xpos.axes, batch=True)
        expected = [FieldIndexer("xpos", row, xpos.axes)[key] for row in rows]
        np.testing.assert_array_equal(batch[key], expected)
        batch[key] = -1.0
        for row, values in zip(np.asarray(batch), rows.copy(), strict=True):
            FieldIndexer("xpos", values, xpos.axes)[key] = -1.0
            np.testing.assert_array_equal(row, values)


def test_a_mask_of_all_axes_and_another_item_are_refused(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    mask = np.ones(xpos.shape, bool)
    batch = FieldIndexer("xpos", np.zeros((physics.model.nbody, *xpos.shape)), xpos.axes, True)
    for indexer in (xpos, batch):
        with pytest.raises(IndexError, match="too many indices"):
            indexer[mask, "x"]


def test_a_row_of_names_is_a_view_and_a_list_of_names_is_not(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    view, copied = xpos["boat"], xpos[["boat", "boom"]]
    assert np.shares_memory(view, physics.data.xpos)
    assert not np.shares_memory(copied, physics.data.xpos)
    xpos["boat"][2] = 9.0
    assert physics.data.xpos[1, 2] == 9.0
    named(physics, "qpos")["float"][:3] = 1.0
    np.testing.assert_array_equal(physics.data.qpos[:3], [1.0, 1.0, 1.0])


def test_cached_keys_do_not_collide(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    for _ in range(2):
        assert xpos["boat", "x"].shape == ()
        assert xpos[["boat", "boom"]].shape == (2, 3)
        assert xpos[("boat",)].shape == (3,)
        assert xpos[["boat"]].shape == (1, 3)
        assert xpos[[["boat", "boom"]]].shape == (1, 2, 3)
        assert xpos["boat", ["x"]].shape == (1,)
        assert xpos[["boat"], "x"].shape == (1,)
        assert len(xpos[1:5, "x"]) == 2 * len(xpos[1:5:2, "x"]) == 4
        assert len(xpos[1:, "x"]) == len(xpos[1:4, "x"]) + len(xpos[4:, "x"])
        # Equal and hashed alike, yet no two are the same key.
        assert xpos[1].shape == (3,)
        assert xpos[True].shape == (1, *physics.data.xpos.shape)
        assert xpos[np.array([True] + [False] * (physics.model.nbody - 1))].shape == (1, 3)


_MIXED_KEYS: list[Any] = [
    ("boat", slice(None, 2)),
    (slice(1, None), ["x", "z"]),
    (slice(None, None, 2), "y"),
    (["boat", "mast"], slice(1, 3)),
    (2, ["x", "z"]),
    ([0, 2], "x"),
    ([0, 2], [0, 1]),
    slice(1, 3),
    [1, 0],
    -1,
]


@pytest.mark.parametrize("key", _MIXED_KEYS, ids=str)
def test_keys_that_mix_names_with_numbers_and_slices_are_cached(physics: Physics, key: Any) -> None:
    xpos = named(physics, "xpos")
    batch = FieldIndexer("xpos", np.random.default_rng(0).random((4, *xpos.shape)), xpos.axes, True)
    for indexer in (xpos, batch):
        expected = np.array(indexer[key])
        assert len(indexer._known) == 1
        np.testing.assert_array_equal(indexer[key], expected)
        indexer[key] = expected + 1.0
        np.testing.assert_array_equal(indexer[key], expected + 1.0)
        assert len(indexer._known) == 1


def test_cached_keys_distinguish_ints_bools_and_floats(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    mask = [True, True] + [False] * (physics.model.nbody - 2)
    for _ in range(2):
        assert xpos[[1, 1], "x"].shape == (2,)
        assert xpos[1, "x"].shape == ()
        assert xpos[True].shape == (1, *physics.data.xpos.shape)
        np.testing.assert_array_equal(xpos[mask, "x"], physics.data.xpos[:2, 0])
        with pytest.raises(IndexError):
            xpos[1.0, "x"]


def test_a_loop_over_many_keys_fills_no_memory(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    for start in range(-2000, 0):
        xpos["boat", start:]
    assert len(xpos._known) <= 1000


def test_a_list_of_names_may_change_after_its_use(physics: Physics) -> None:
    xpos, key = named(physics, "xpos"), ["boat", "boom"]
    np.testing.assert_array_equal(xpos[key], physics.data.xpos[[1, 3]])
    key[1] = "mast"
    np.testing.assert_array_equal(xpos[key], physics.data.xpos[[1, 2]])


def test_cached_keys_read_the_current_values(physics: Physics) -> None:
    before = named(physics, "xpos")["boat", "z"], named(physics, "qpos")[["rope", "yaw"]]
    physics.step(20)
    after = named(physics, "xpos")["boat", "z"], named(physics, "qpos")[["rope", "yaw"]]
    assert after[0] == physics.data.xpos[1, 2] != before[0]
    np.testing.assert_array_equal(after[1], physics.data.qpos[[12, 11]])


@pytest.mark.parametrize(
    ("key", "error", "match"),
    [
        ("mst", KeyError, r"no body is named 'mst'.*Did you mean 'mast'\?.*Names: world, boat"),
        (("boat", "w"), KeyError, "no column is named 'w'. Names: x, y, z"),
        (["boat", "mst"], KeyError, "'mst'"),
        (..., IndexError, "Ellipsis"),
        ((..., "x"), IndexError, "Ellipsis"),
        ((..., "boat", "x"), IndexError, "leave out `...`, also in a batch"),
        (None, IndexError, "None"),
        (("boat", None), IndexError, "None"),
        ("", IndexError, "Empty strings"),
        (b"", IndexError, "Empty strings"),
        (["boat", ""], IndexError, "Empty strings"),
        ([["boat", None]], IndexError, "None"),
        (("boat", "x", 0), IndexError, "3 elements, but array has only 2"),
        (99, IndexError, "out of bounds"),
    ],
)
def test_invalid_keys_are_refused(physics: Physics, key: Any, error: Any, match: str) -> None:
    xpos = named(physics, "xpos")
    batch = FieldIndexer("xpos", np.zeros((2, *xpos.shape)), xpos.axes, batch=True)
    before = physics.data.xpos.copy()
    for indexer in (xpos, batch):
        with pytest.raises(error, match=match):
            indexer[key]
        with pytest.raises(error, match=match):
            indexer[key] = 0.0
    np.testing.assert_array_equal(physics.data.xpos, before)


def test_a_field_without_names_takes_numbers_only(physics: Physics) -> None:
    gravity = FieldIndexer("gravity", physics.model.opt.gravity, Axes(Axis()))
    assert gravity[2] == -9.81
    for key in ("z", ["z"]):
        with pytest.raises((KeyError, IndexError)):
            gravity[key]


def test_axes_give_the_names_of_rows_and_columns(physics: Physics) -> None:
    axes = named(physics, "xpos").axes
    assert axes.row.names == ["world", "boat", "mast", "boom", "buoy", "anchor", ""]
    assert axes.col.names == ["x", "y", "z"]
    assert axes._fields == ("row", "col")
    assert named(physics, "qpos").axes.row.names == ["float", "swivel", "yaw", "rope"]
    assert named(physics, "qpos").axes.col is None
    assert axes.row.convert_key_item("mast") == 2
    assert not hasattr(Axis(), "names")


def test_an_indexer_forwards_attributes_to_its_array(physics: Physics) -> None:
    xpos = named(physics, "xpos")
    assert xpos.shape == physics.data.xpos.shape
    assert xpos.dtype == float
    assert len(xpos) == physics.model.nbody
    np.testing.assert_array_equal(xpos.mean(axis=0), physics.data.xpos.mean(axis=0))
    copied = np.array(xpos)
    assert not np.shares_memory(copied, physics.data.xpos)
    assert np.asarray(xpos, np.float32).dtype == np.float32
    assert {"mean", "shape", "axes"} <= set(dir(xpos))
    with pytest.raises(AttributeError, match="nothing"):
        xpos.nothing  # noqa: B018


def test_repr_shows_each_row_with_its_name(physics: Physics) -> None:
    lines = repr(named(physics, "xpos")).splitlines()
    assert lines[0] == "FieldIndexer(xpos):"
    assert lines[1].split() == ["x", "y", "z"]
    assert len(lines) == 2 + physics.model.nbody
    assert lines[2 + 4].split()[:2] == ["4", "buoy"]
    assert "2" in lines[2 + 4].split("buoy")[1]
    assert lines[-1].split()[0] == "6"
    labels = [line.split()[1] for line in repr(named(physics, "qpos")).splitlines()[1:]]
    assert labels == ["float"] * 7 + ["swivel"] * 4 + ["yaw", "rope"]
    batch = FieldIndexer("x", np.zeros((4, 2, 3)), named(physics, "xpos").axes, batch=True)
    assert repr(batch) == "FieldIndexer(x): a batch of shape (4, 2, 3)"
    physics = Physics.from_xml_string(_KEYED)
    head = repr(physics.named.model.key_qpos).splitlines()[1]
    assert head.split() == ["root"] * 7 + ["hinge"]  # as many as there are numbers


_KEYED = """
<mujoco>
  <worldbody>
    <body><freejoint name="root"/><geom size="1"/>
      <body><joint name="hinge"/><geom size="1"/></body>
    </body>
  </worldbody>
  <keyframe><key name="k"/></keyframe>
</mujoco>
"""


def test_a_named_field_is_not_copied_without_its_physics(physics: Physics) -> None:
    for one in (physics.named.data.qpos, physics.named):
        with pytest.raises(TypeError, match="belongs to its physics: copy or pickle that"):
            pickle.dumps(one)
    empty = Physics.from_xml_string("<mujoco/>")
    assert "(empty)" in repr(empty.named.data.qpos)


def test_fields_are_listed_and_looked_up_by_name(physics: Physics) -> None:
    for view, struct in (
        (physics.named.data, physics.data.ptr),
        (physics.named.model, physics.model.ptr),
    ):
        names = dir(view)
        assert {"xpos", "qpos"} <= set(names) or {"body_pos", "qpos0"} <= set(names)
        for name in names:
            np.testing.assert_array_equal(np.asarray(getattr(view, name)), getattr(struct, name))
            assert repr(getattr(view, name))
        assert set(view._asdict()) == set(names)
    assert not hasattr(physics.named.data, "time")
    with pytest.raises(AttributeError, match=r"MjData has no field 'qposs'.*'qpos'\?"):
        physics.named.data.qposs  # noqa: B018


def test_an_actuator_may_have_several_controls_outputs_and_activations() -> None:
    physics = Physics.from_xml_string(
        """
        <mujoco>
          <worldbody>
            <body name="arm"><joint name="x"/><geom size=".1"/></body>
            <body name="top"><joint name="turn" type="ball"/><geom size=".1"/></body>
          </worldbody>
          <actuator>
            <pid name="servo" joint="x" kp="10" kv="2" input="pos vel ff"/>
            <orientation name="turn" joint="turn" kp="1" input="quat"/>
            <motor name="motor" joint="x" gear="7"/>
          </actuator>
        </mujoco>
        """
    )
    data, model = physics.named.data, physics.named.model
    physics.set_control(np.arange(physics.model.nu))
    assert data.ctrl["servo"].tolist() == [0, 1, 2]
    assert data.ctrl["turn"].tolist() == [3, 4, 5, 6]
    assert data.ctrl["motor"] == 7
    physics.forward()
    assert physics.model.nout > physics.model.nactuator
    assert data.actuator_force["turn"].shape == (physics.model.nout - 2,)
    assert data.actuator_force["motor"] == 7
    assert model.actuator_gear["motor", 0] == 7
    assert model.actuator_ctrlrange["turn"].shape == (4, 2)


def test_every_row_and_column_that_has_names_has_as_many_as_there_are(physics: Physics) -> None:
    """For the installed MuJoCo, every rule in `fields` matches the length of its axis."""
    for struct, view in (("MjData", physics.named.data), ("MjModel", physics.named.model)):
        seen = 0
        for name, indexer in view._asdict().items():
            sizes = fields.axes_of(struct, name, indexer.ndim)
            assert len(sizes) == min(indexer.ndim, 2), name
            for length, size, axis in zip(indexer.shape, sizes, indexer.axes, strict=False):
                if size is None or not length:
                    continue
                seen += 1
                names = list(filter(None, axis.names))
                rows = [row for n in names for row in axis.convert_key_item([n])]
                assert all(row < length for row in rows), (name, size)
                # A row of wrap_xpos is two points, of which the first has names, as in dm_control.
                if size in (*fields.OBJECTS, "nu", "nout") or (
                    size in fields.COLUMN_NAMES and name != "wrap_xpos"
                ):
                    assert len(axis.names) == length, (name, size)
        assert seen > 40, "hardly any field has names"


@pytest.mark.parametrize(
    ("struct", "field", "expected"),
    [
        ("MjData", "xpos", ("nbody", "xyz")),
        ("MjData", "qvel", ("nv",)),
        ("MjData", "qfrc_bias", ("nv",)),
        ("MjData", "efc_J", (None, None)),
        ("MjData", "ctrl", ("nu",)),
        ("MjModel", "body_pos", ("nbody", "xyz")),
        ("MjModel", "geom_quat", ("ngeom", "quat")),
        ("MjModel", "dof_damping", ("nv",)),
        ("MjModel", "jnt_range", ("njnt", None)),
        ("MjModel", "qpos0", ("nq",)),
        ("MjModel", "key_qpos", ("nkey", "nq")),
        ("MjModel", "cam_mat0", ("ncam", "mat")),
        ("MjModel", "mat_rgba", ("nmat", "rgba")),
        ("MjModel", "numeric_data", ("nnumericdata",)),
        ("MjModel", "a_field_of_the_future", (None, None)),
        ("MjModel", "opt", (None,)),
        ("MjData", "geom_xpos", ("ngeom", "xyz")),
        ("MjData", "dof_island", (None,)),
        ("MjData", "qvel", ()),
    ],
)
def test_the_axes_of_a_field(struct: str, field: str, expected: tuple[str | None, ...]) -> None:
    assert fields.axes_of(struct, field, len(expected)) == expected


@pytest.mark.parametrize(
    "xml",
    [
        "<mujoco/>",
        "<mujoco><worldbody><body/></worldbody></mujoco>",
        "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>",
        "<mujoco><worldbody><body name='größer ☃'/></worldbody></mujoco>",
    ],
)
def test_models_without_names_or_objects_have_indexers(xml: str) -> None:
    physics = Physics.from_xml_string(xml)
    for view in physics.named:
        for indexer in view._asdict().values():
            assert repr(indexer)
            np.testing.assert_array_equal(indexer[:], np.asarray(indexer))
    if "☃" in xml:
        assert physics.named.data.xpos["größer ☃"].shape == (3,)


def test_names_are_read_lazily_and_once() -> None:
    model = mujoco.MjModel.from_xml_string(_XML)
    names = Names(model)
    assert names.axis("nbody") is names.axis("nbody")
    assert list(names._axes) == [None, "nbody"]


def test_all_pairs_of_names_of_a_matrix_are_its_elements(physics: Physics) -> None:
    xmat = named(physics, "xmat")
    rows, columns = filter(None, xmat.axes.row.names), xmat.axes.col.names
    for (i, row), (j, column) in itertools.product(enumerate(rows), enumerate(columns)):
        assert xmat[row, column] == physics.data.xmat[i, j]


def test_a_field_cannot_be_replaced_by_mistake() -> None:
    named = Physics.from_xml_string("<mujoco/>").named
    with pytest.raises(AttributeError, match=r"set its elements: named\.data\.qpos\[:\] = "):
        named.data.qpos = 1.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(AttributeError, match=r"named\.model\.body_mass cannot be replaced"):
        named.model.body_mass = 1.0  # pyright: ignore[reportAttributeAccessIssue]


def test_named_integers_of_a_model_are_read_as_ordinary_arrays_and_written_with_a_check() -> None:
    physics = suite.load("walker", "walk").physics
    batch = physics.replicate(2, 1).physics.named.model
    for field in (physics.named.model.geom_bodyid, batch.geom_bodyid, batch.geom_type):
        assert type(field[:2]) is np.ndarray
    for named in (physics.named.model, batch):
        for field in (named.geom_bodyid, named.geom_type):
            assert type(field[[0, 1]]) is np.ndarray
            assert type(field["floor"]) is np.int32
            with pytest.raises(ValueError, match=r"geom_(bodyid|type).*"):
                field["floor"] = 106
    physics.named.model.geom_type["torso"] = 5
    assert physics.model._official.geom_type[1] == 5


def test_a_view_of_named_integers_is_written_with_a_check() -> None:
    physics = suite.load("cartpole", "balance").physics
    named, model = physics.named.model, physics.model
    named.mat_texid["grid"][1] = 0
    named.mat_texid["grid"] += 0
    named.geom_matid[:] *= 1
    named.cam_resolution["fixed"][0] = 2
    view = named.geom_condim[:]
    view[0] = 4
    assert (model._official.geom_condim[0], *model._official.cam_resolution[0]) == (4, 2, 1)
    for write in (lambda: view.fill(2), lambda: named.mat_texid["grid"].fill(99)):
        with pytest.raises(ValueError, match=r"cannot be (2|99).*nothing was changed"):
            write()
    copied = named.geom_condim[[0, 1]]
    copied[:] = 99
    assert model._official.geom_condim[0] == 4
