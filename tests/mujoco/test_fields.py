"""Names of the axes of fields, and the fields that may differ per row."""

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import fields

_XML = """
<mujoco>
  <worldbody>
    <body name="one"><freejoint/><geom name="a" size=".1"/><geom name="b" size=".1"/></body>
    <body name="two"><joint name="hinge"/><geom name="c" size=".1"/></body>
  </worldbody>
  <custom><numeric name="n" data="1 2 3"/></custom>
  <keyframe><key name="k" qpos="0 0 0 1 0 0 0 .5"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_XML)


def _axes(model: mujoco.MjModel, field: str) -> tuple[str | None, ...]:
    return fields.axes_of("MjModel", field, getattr(model, field).ndim)


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        ("body_pos", ("nbody", "xyz")),
        ("body_mass", ("nbody",)),
        ("body_quat", ("nbody", "quat")),
        ("key_qpos", ("nkey", "nq")),
        ("key_qvel", ("nkey", "nv")),
        ("key_ctrl", ("nkey", "nu")),
        ("numeric_data", ("nnumericdata",)),
        ("dof_damping", ("nv",)),
        ("mesh_vert", (None, "xyz")),
        ("flex_matid", (None,)),
        ("M_rownnz", ("nv",)),
        ("B_rownnz", ("nbody",)),
    ],
)
def test_rows_and_columns_of_a_models_field(
    model: mujoco.MjModel, field: str, expected: tuple[str | None, ...]
) -> None:
    assert _axes(model, field) == expected


def test_every_size_that_names_an_axis_is_one_of_the_model(model: mujoco.MjModel) -> None:
    named = {size for name in dir(model)
             if isinstance(value := getattr(model, name), np.ndarray)
             for size in fields.axes_of("MjModel", name, value.ndim) if size}  # fmt: skip
    assert {"nbody", "njnt", "nv", "nq", "ngeom"} <= named
    for size in named - set(fields.COLUMN_NAMES):
        assert hasattr(model, size), size


def test_a_matrix_is_named_in_row_major_order() -> None:
    rows = ["".join(pair) for pair in ((r, c) for r in "xyz" for c in "xyz")]
    assert fields.COLUMN_NAMES["mat"] == rows


def test_the_numbers_of_objects_that_have_several_start_where_the_model_says(
    model: mujoco.MjModel,
) -> None:
    kind, start = fields.RAGGED["nq"]
    assert kind == "jnt"
    assert getattr(model, start).tolist() == [0, 7]
    assert getattr(model, fields.RAGGED["nv"][1]).tolist() == [0, 6]


@pytest.mark.parametrize(
    "name", ["body_mass", "geom_priority", "geom_contype", "geom_condim", "opt.gravity"]
)
def test_fields_that_hold_values_may_be_randomised(name: str) -> None:
    fields.check_randomizable(name)


@pytest.mark.parametrize(
    "name", ["geom_type", "body_parentid", "jnt_qposadr", "opt.timestep", "opt.integrator"]
)
def test_structural_fields_may_not_be_randomised(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' is part of the model's structure"):
        fields.check_randomizable(name)


def test_an_unknown_field_is_refused_with_a_suggestion() -> None:
    with pytest.raises(ValueError, match="Did you mean 'body_mass'"):
        fields.check_randomizable("body_mas")


@pytest.mark.parametrize("name", ["hfield_data", "mesh_vert", "skin_rgba"])
def test_data_that_all_rows_share_may_not_be_randomised(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' is data of a texture, .*all rows share"):
        fields.check_randomizable(name)
    with pytest.raises(ValueError, match="MjModel has no field 3 to randomise"):
        fields.check_randomizable(3)  # pyright: ignore[reportArgumentType]
