"""Names along the axes of MuJoCo's fields.

The rules follow MuJoCo's own naming of its struct fields: `geom_pos` has one row per geom, `dof_*`
one per degree of freedom. A field that matches no rule has unnamed axes, so new fields need no
change here.
"""

import functools
import operator
from collections.abc import Iterable

import mujoco.batch
import numpy as np

from limberjack.mujoco.wrapper.model import empty_model
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "ACTUATORS",
    "COLUMN_NAMES",
    "OBJECTS",
    "RAGGED",
    "axes_of",
    "check_randomizable",
    "fields_of_rows",
    "nominal",
    "of_floats",
]

# Object kind counted by each size, spelled as in `MjModel.name_<kind>adr`.
OBJECTS = {
    "nbody": "body",
    "njnt": "jnt",
    "ngeom": "geom",
    "nsite": "site",
    "ncam": "cam",
    "nlight": "light",
    "nflex": "flex",
    "nmesh": "mesh",
    "nskin": "skin",
    "nhfield": "hfield",
    "ntex": "tex",
    "nmat": "mat",
    "npair": "pair",
    "nexclude": "exclude",
    "neq": "eq",
    "ntendon": "tendon",
    "nactuator": "actuator",
    "nsensor": "sensor",
    "nnumeric": "numeric",
    "ntext": "text",
    "ntuple": "tuple",
    "nkey": "key",
    "nplugin": "plugin",
}

# Sizes along which an object may span several elements: the object's kind, and the field with the
# address of each object's first element.
RAGGED = {
    "nq": ("jnt", "jnt_qposadr"),
    "nv": ("jnt", "jnt_dofadr"),
    "nsensordata": ("sensor", "sensor_adr"),
    "nnumericdata": ("numeric", "numeric_adr"),
}

# Those of actuators, and the field with the number of elements of each: activations, controls, and
# outputs, of which most actuators have one.
ACTUATORS = {"na": "actuator_actnum", "nu": "actuator_ctrlnum", "nout": "actuator_outnum"}

COLUMN_NAMES = {
    "xyz": ["x", "y", "z"],
    "quat": ["qw", "qx", "qy", "qz"],
    "mat": ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"],
    "rgba": ["r", "g", "b", "a"],
}

# Fields of MjModel: the size of the rows by the prefix before the first underscore.
_MODEL_PREFIXES = {
    **{size.removeprefix("n"): size for size in OBJECTS if size != "nplugin"},
    "dof": "nv",
}
# Exceptions, whose rows do not follow from their prefix.
_MODEL_ROWS = {
    "qpos0": "nq",
    "qpos_spring": "nq",
    "numeric_data": "nnumericdata",
    **dict.fromkeys(("actuator_ctrlrange", "actuator_ctrllimited"), "nu"),
    **{f"actuator_{name}": "nout" for name in ("gear", "acc0", "length0", "lengthrange")},
    "plugin": "nplugin",
    "plugin_attradr": "nplugin",
    "plugin_stateadr": "nplugin",
    "plugin_statenum": "nplugin",
    **dict.fromkeys(("M_rowadr", "M_rownnz", "D_diag", "D_rowadr", "D_rownnz"), "nv"),
    **dict.fromkeys(("B_rowadr", "B_rownnz"), "nbody"),
    **dict.fromkeys(("ten_J_rowadr", "ten_J_rownnz"), "ntendon"),
    **{f"name_{kind}adr": size for size, kind in OBJECTS.items()},
}
# Fields that pool the data of all objects of a kind, so that rows do not correspond to objects.
_MODEL_POOLS = (
    "hfield_data tex_data text_data tuple_objid tuple_objprm tuple_objtype "
    "mesh_face mesh_facenormal mesh_facetexcoord mesh_graph mesh_normal mesh_polynormal "
    "mesh_polyvertadr mesh_polyvertnum mesh_polymap mesh_polyvert mesh_texcoord "
    "mesh_polymapadr mesh_polymapnum mesh_vert skin_bonebindpos skin_bonebindquat "
    "skin_bonebodyid skin_bonevertadr skin_bonevertnum skin_bonevertid skin_bonevertweight "
    "skin_face skin_texcoord skin_vert flex_bending flex_edge flex_edgeflap flex_elemlayer "
    "flex_elem flex_elemtexcoord flex_elemedge flex_node flex_node0 flex_nodebodyid "
    "flex_shell flex_stiffness flex_texcoord flex_vert flex_vert0 flex_vertbodyid plugin_attr"
)
_MODEL_COLUMNS = {"key_qpos": "nq", "key_qvel": "nv", "key_act": "na", "key_ctrl": "nu"}

# Fields of MjData by the size of their rows.
_DATA_FIELDS = {
    "nq": "qpos",
    "nv": (
        "qvel qacc qacc_smooth qacc_warmstart qfrc_applied qfrc_actuator qfrc_adhesion qfrc_bias "
        "qfrc_constraint qfrc_damper qfrc_fluid qfrc_gravcomp qfrc_inverse qfrc_passive "
        "qfrc_smooth qfrc_spring qLDiagInv qHDiagInv cdof cdof_dot dof_awake_ind"
    ),
    "na": "act act_dot",
    "nu": "ctrl",
    "nout": "actuator_force actuator_length actuator_velocity moment_rowadr moment_rownnz",
    "nbody": (
        "xpos xquat xmat xipos ximat xfrc_applied subtree_com subtree_linvel subtree_angmom cinert "
        "crb cvel cacc cfrc_int cfrc_ext body_awake body_awake_ind parent_awake_ind"
    ),
    "njnt": "xanchor xaxis",
    "ngeom": "geom_xpos geom_xmat",
    "nsite": "site_xpos site_xmat",
    "ncam": "cam_xpos cam_xmat",
    "nlight": "light_xpos light_xdir",
    "nmocap": "mocap_pos mocap_quat",
    "neq": "eq_active",
    "ntendon": "ten_length ten_velocity ten_wrapadr ten_wrapnum",
    "nsensordata": "sensordata",
    "nflex": "flex_hessian_valid",
    "nplugin": "plugin plugin_data",
}
_DATA_ROWS = {name: size for size, names in _DATA_FIELDS.items() for name in names.split()}

# Fields with named columns, by the kind of names.
_COLUMN_FIELDS = {
    "xyz": (
        "body_pos body_ipos body_inertia jnt_pos jnt_axis geom_size geom_pos site_size site_pos "
        "cam_pos cam_poscom0 cam_pos0 light_pos light_dir light_poscom0 light_pos0 light_dir0 "
        "mesh_vert mesh_normal mocap_pos xpos xipos xanchor xaxis geom_xpos site_xpos cam_xpos "
        "light_xpos light_xdir subtree_com subtree_linvel subtree_angmom wrap_xpos"
    ),
    "quat": "body_quat body_iquat geom_quat site_quat cam_quat mocap_quat xquat",
    "mat": "cam_mat0 xmat ximat geom_xmat site_xmat cam_xmat",
    "rgba": "geom_rgba site_rgba skin_rgba mat_rgba tendon_rgba",
}
_COLUMNS = {name: column for column, names in _COLUMN_FIELDS.items() for name in names.split()}


def axes_of(
    struct_name: str, field: str, shape: tuple[int, ...], model: mujoco.MjModel
) -> tuple[str | None, ...]:
    """Size names of a field's first two axes, such as ('nbody', 'xyz'); None if unnamed.

    Args:
      struct_name: 'MjModel' or 'MjData'.
      field: the field's name.
      shape: the field's shape in one simulation.
      model: the official model.
    """
    if struct_name == "MjData":
        row = _DATA_ROWS.get(field)
    else:
        row = _MODEL_ROWS.get(field) or _model_row(field, shape, model)
    column = _COLUMNS.get(field) or _MODEL_COLUMNS.get(field)
    return (row, column)[: len(shape)]


def _model_row(field: str, shape: tuple[int, ...], model: mujoco.MjModel) -> str | None:
    """The size implied by a field's prefix, if it matches the field's length."""
    if field in _MODEL_POOLS.split():
        return None
    size = _MODEL_PREFIXES.get(field.split("_")[0])
    return size if size is not None and shape and shape[0] == getattr(model, size) else None


# Options that must stay constant during a run.
_FIXED_OPTIONS = ("opt.timestep", "opt.integrator", "opt.disableflags", "opt.enableflags")
# Integer fields that hold values, as opposed to addresses, counts or types.
_VALUES = ("contype", "conaffinity", "condim", "priority")


def fields_of_rows() -> frozenset[str]:
    """Fields of MjModel that can differ per row of a batch; options as 'opt.*'.

    Those in `mujoco.batch.MODEL_FIELDS` cost the least: see `limberjack.mujoco.row_fields`.
    """
    return mujoco.batch.MODEL_FIELDS.union(of_floats())


def check_randomizable(name: str) -> None:
    """Raises ValueError unless rows of a batch may differ in this model field."""
    known = mujoco.batch.MODEL_FIELDS
    is_array = isinstance(getattr(empty_model(), str(name), None), np.ndarray)
    if name not in known and not is_array:
        raise ValueError(
            f"MjModel has no field {name!r} to randomise.{did_you_mean(name, sorted(known))} "
            "Use a field name of mujoco.MjModel, or one such as 'opt.gravity'."
        )
    is_value = name.startswith("opt.") or _is_value(name)
    if name not in known or name in _FIXED_OPTIONS or not is_value:
        what = "part of the model's structure"
        if is_value and name not in known:
            what = "data of a texture, height field, mesh or skin"
        raise ValueError(f"{name!r} is {what}, which all rows share; it cannot be randomised")


def nominal(model: mujoco.MjModel, names: Iterable[str]) -> dict[str, np.ndarray]:
    """The model's values of the fields to be randomised, by name.

    Raises:
      ValueError: there is no such field, or it is part of the model's structure.
    """
    values = {}
    for name in names:
        check_randomizable(name)
        values[name] = np.array(operator.attrgetter(name)(model))
    return values


@functools.cache
def of_floats() -> tuple[str, ...]:
    """Fields of MjModel that are floating-point arrays."""
    model = empty_model()
    found = ((name, getattr(model, name)) for name in dir(model) if not name.startswith("_"))
    return tuple(n for n, f in found if isinstance(f, np.ndarray) and f.dtype.kind == "f")


def _is_value(name: str) -> bool:
    """Whether a field of MjModel is floating point, or an integer field that holds values."""
    field = getattr(empty_model(), name)
    return np.issubdtype(field.dtype, np.floating) or name.endswith(_VALUES)
