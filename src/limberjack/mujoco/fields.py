"""Names along the axes of MuJoCo's fields.

MuJoCo declares the sizes of its fields: `geom_pos` has one row for each geom, `dof_*` one for each
degree of freedom. So new fields need no change here, except names of columns.
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

# Sizes whose elements have names.
_NAMED = frozenset((*OBJECTS, *RAGGED, *ACTUATORS, "nmocap"))

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


def axes_of(struct_name: str, field: str, dimensions: int) -> tuple[str | None, ...]:
    """Size names of a field's first two axes, such as ('nbody', 'xyz'); None if unnamed.

    Args:
      struct_name: 'MjModel' or 'MjData'.
      field: the field's name.
      dimensions: the number of its axes in one simulation.
    """
    row, column = _declared(struct_name).get(field, (None, None))
    return (row, _COLUMNS.get(field, column))[:dimensions]


@functools.cache
def _declared(struct_name: str) -> dict[str, tuple[str | None, str | None]]:
    """The named sizes along the first two axes of each field, as MuJoCo declares them.

    Fields of MjData from `contact` on lie in its arena, where they move between steps: theirs are
    unnamed.
    """
    from mujoco.introspect.ast_nodes import StructFieldDecl
    from mujoco.introspect.structs import STRUCTS  # takes 16 ms; not every program uses names

    found = {}
    for field in STRUCTS[struct_name.replace("Mj", "mj")].fields:
        if not isinstance(field, StructFieldDecl):  # a union without a name
            continue
        if field.name == "contact":
            break
        sizes = getattr(field, "array_extent", None) or ()
        row, column, *_ = [*(size if size in _NAMED else None for size in sizes), None, None]
        found[field.name] = (row, column)
    return found


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
