"""Domains that are drawn without dm_control's files: the parts of their models that are compared.

    for name, ours, theirs in compared_fields("dog", our_model, their_model):
        assert_same(ours, theirs, name)

This project ships no meshes, skins and pictures of others. Such a domain has masses and inertias as
numbers, geoms that collide as dm_control has them, and its own looks. Everything is compared except
what `NOT_COMPARED` names; geoms and materials are compared by the names that both models have.
"""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from .same import assert_same, fields

__all__ = ["DOMAINS", "NOT_COMPARED", "compared_fields", "compared_names", "compared_part"]

DOMAINS = {"dog": "dm_control's bones, skin and ball come from 177 files, which are not shipped"}

# Fields of MjModel by their names or, with *, by how those begin, and why they differ.
NOT_COMPARED = {
    **dict.fromkeys(("mesh_*", "nmesh*", "skin_*", "nskin*", "tex_*", "ntex*"), "files"),
    **dict.fromkeys(("paths", "npaths"), "names of files"),
    **dict.fromkeys(("geom_group", "geom_matid", "geom_rgba"), "how geoms are drawn"),
    **dict.fromkeys(("body_geomadr", "body_geomnum"), "numbers of geoms; geom_bodyid is compared"),
    **dict.fromkeys(("name*", "nnames*"), "addresses of names; the names are compared"),
    **dict.fromkeys(("ngeom", "nmat", "nbvh*", "nbuffer", "_sizes"), "sizes of all this"),
    "signature": "a checksum of the sizes",
    "dof_length": "derived from the extents of geoms, meshes included; only sleeping reads it",
}
_DIFFERENT = frozenset(NOT_COMPARED)
_BY_NAME = {"geom": mujoco.mjtObj.mjOBJ_GEOM, "mat": mujoco.mjtObj.mjOBJ_MATERIAL}
_TYPES = {"geom": "geom", "material": "mat"}
_MESH = mujoco.mjtGeom.mjGEOM_MESH.value


def _is_compared(field: str) -> bool:
    return field not in _DIFFERENT and not any(
        field.startswith(name[:-1]) for name in _DIFFERENT if name.endswith("*")
    )


def _names(model: Any, kind: str) -> list[str]:
    number = model.ngeom if kind == "geom" else model.nmat
    return [mujoco.mj_id2name(model, _BY_NAME[kind], index) for index in range(number)]


def _common(models: tuple[Any, Any], kind: str) -> list[np.ndarray]:
    """The numbers of the objects that both models have, of each model.

    Meshes do not count, and all other geoms that only one of the models has collide with nothing.
    """
    names = [_names(model, kind) for model in models]
    common = set(names[0]) & set(names[1])
    for model, of in zip(models, names, strict=True):
        if kind == "geom":
            common -= {name for i, name in enumerate(of) if model.geom_type[i] == _MESH}
    found = [np.array([i for i, name in enumerate(of) if name in common]) for of in names]
    for model, numbers in zip(models, found, strict=True):
        if kind == "geom":
            others = np.setdiff1d(np.arange(model.ngeom), numbers)
            assert not model.geom_contype[others].any()
            assert not model.geom_conaffinity[others].any()
    return found


def compared_names(
    domain: str, kind: str, models: tuple[Any, Any], names: list[list[str]]
) -> list[list[str]]:
    """The names of objects of a kind in both models, less those not compared."""
    if domain not in DOMAINS:
        return names
    if kind in ("mesh", "texture"):
        return [[], []]
    if kind not in _TYPES:
        return names
    common = _common(models, _TYPES[kind])
    return [[of[i] for i in numbers] for of, numbers in zip(names, common, strict=True)]


def compared_part(domain: str, field: str, models: tuple[Any, Any], values: Any) -> Any:
    """The values of a field in both models, less those of objects that are not compared.

    Returns:
      A pair; None if the field is not compared.
    """
    if domain not in DOMAINS:
        return values
    if not _is_compared(field):
        return None
    kind = field.partition("_")[0]
    if kind in _BY_NAME:
        return [value[of] for value, of in zip(values, _common(models, kind), strict=True)]
    if kind == "bvh":  # the trees of the bodies come before those of the meshes
        values = [v[: m.body_bvhnum.sum()] for v, m in zip(values, models, strict=True)]
    if field == "bvh_nodeid":
        names = [[*_names(model, "geom"), None] for model in models]
        return [[of[node] for node in nodes] for of, nodes in zip(names, values, strict=True)]
    return values


def compared_fields(domain: str, ours: Any, theirs: Any) -> Iterator[tuple[str, Any, Any]]:
    """Name and values of each field that is compared."""
    both = dict(fields(ours)), dict(fields(theirs))
    assert_same(list(both[0]), list(both[1]), "names of fields")
    for field in both[1]:
        values = [of[field] for of in both]
        part = compared_part(domain, field, (ours, theirs), values)
        if part is not None:
            yield field, *part
