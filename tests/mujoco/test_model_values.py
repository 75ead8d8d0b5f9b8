"""`checksums` of a model's fields, detection of changed fields, and a model's identity."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from limberjack import mujoco as mujoco_layer
from limberjack import suite
from limberjack.mujoco.model_values import changed_fields, checksums, derived_fields, identity

from .furnished import FURNISHED


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(FURNISHED)


def _set_flag(model: mujoco.MjModel) -> None:
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT.value


_EDITS: dict[str, Callable[[mujoco.MjModel], object]] = {
    "body_mass": lambda model: model.body_mass.__setitem__(1, model.body_mass[1] + 1e-12),
    "geom_contype": lambda model: model.geom_contype.__setitem__(0, 2),
    "hfield_data": lambda model: model.hfield_data.__setitem__(4, 0.5),
    "mesh_vert": lambda model: model.mesh_vert.__setitem__((0, 0), 0.5),
    "tex_data": lambda model: model.tex_data.__setitem__(-1, model.tex_data[-1] ^ 1),
    "opt.gravity": lambda model: model.opt.gravity.__setitem__(2, -9.80),
    "opt.timestep": lambda model: setattr(model.opt, "timestep", 0.001),
    "opt.disableflags": _set_flag,
}


@pytest.mark.parametrize("field", _EDITS)
def test_a_changed_field_is_named(model: mujoco.MjModel, field: str) -> None:
    before = checksums(model)
    _EDITS[field](model)
    assert changed_fields(before, checksums(model)) == [field]


@pytest.mark.parametrize("field", _EDITS)
def test_a_field_that_is_left_out_does_not_count(model: mujoco.MjModel, field: str) -> None:
    before = checksums(model, {field})
    assert field not in before
    _EDITS[field](model)
    assert changed_fields(before, checksums(model, {field})) == []


def test_models_of_one_source_have_the_same_checksums(model: mujoco.MjModel) -> None:
    other = mujoco.MjModel.from_xml_string(FURNISHED)
    assert checksums(other) == checksums(model)


def test_every_array_that_is_not_empty_has_a_checksum_and_each_number_of_the_options(
    model: mujoco.MjModel,
) -> None:
    found = checksums(model)
    public = [name for name in dir(model) if not name.startswith("_")]
    fields = {name: getattr(model, name) for name in public}
    arrays = {name for name, f in fields.items() if isinstance(f, np.ndarray) and f.size}
    assert {name for name in found if "." not in name} == arrays
    assert {"opt.gravity", "opt.timestep", "opt.integrator", "opt.wind"} <= set(found)
    assert "flex_vert" not in found  # there is none


def test_changed_fields_are_sorted_and_include_fields_of_one_side_only() -> None:
    assert changed_fields({"b": 1, "a": 1, "c": 1}, {"b": 2, "d": 1, "c": 1}) == ["a", "b", "d"]
    assert changed_fields({}, {}) == []


def test_fields_that_mujoco_derives_follow_from_masses_and_options_and_not_from_colours() -> None:
    assert {"body_subtreemass", "dof_invweight0"} <= derived_fields(["body_mass"])
    assert derived_fields(["geom_rgba", "opt.gravity"]) == derived_fields(["body_mass"])
    assert derived_fields(["geom_rgba"]) == derived_fields([]) == frozenset()


def test_fields_that_mujoco_recomputes_from_a_mass_are_derived_fields(
    model: mujoco.MjModel,
) -> None:
    before = checksums(model)
    model.body_mass[1] *= 2
    mujoco.mj_setConst(model, mujoco.MjData(model))
    changed = set(changed_fields(before, checksums(model)))
    assert {"body_mass", "body_subtreemass"} <= changed
    assert changed - {"body_mass"} <= derived_fields(["body_mass"])


def _walker() -> suite.humanoid.Physics:
    return suite.load("humanoid", "walk").physics


def test_equal_models_have_equal_identities_shared_or_not() -> None:
    shared, own = _walker(), _walker()
    own.model.ptr  # noqa: B018  # from here on a copy of its own
    assert own.model._shared is None
    assert identity(shared.model) == identity(own.model)


@pytest.mark.parametrize("field", ["body_mass", "geom_friction", "dof_damping", "opt.gravity"])
def test_a_model_with_other_numbers_has_another_identity(field: str) -> None:
    physics, expected = _walker(), identity(_walker().model)
    struct = physics.model.opt if field.startswith("opt.") else physics.model
    getattr(struct, field.removeprefix("opt."))[-1] += 1e-9
    changed = identity(physics.model)
    assert {name for name in expected if changed[name] != expected[name]} == {
        "numbers of the model"
    }
    assert identity(physics.model, (field,)) == identity(_walker().model, (field,))


def test_colours_do_not_count() -> None:
    physics = _walker()
    physics.model.mat_rgba[:] = 0.5
    assert identity(physics.model) == identity(_walker().model)


def test_the_patch_of_mujocos_version_does_not_count() -> None:
    assert mujoco.__version__.startswith(f"{identity(_walker().model)['MuJoCo']}.")


def test_a_model_with_other_names_has_another_identity() -> None:
    one, other = (
        mujoco_layer.Physics.from_xml_string(
            f'<mujoco><worldbody><body name="{name}"><freejoint/><geom size="1"/></body>'
            "</worldbody></mujoco>"
        )
        for name in ("ball", "bell")
    )
    changed, expected = identity(one.model), identity(other.model)
    assert {name for name in expected if changed[name] != expected[name]} == {"names"}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["geom_rgba"], False),
        (["body_mass"], True),
        (["geom_rgba", "body_mass"], True),
        (["opt.gravity", "geom_rgba"], True),
        ([], False),
    ],
)
def test_constants_follow_if_any_of_the_fields_is_one_that_they_depend_on(
    names: list[str], expected: bool
) -> None:
    assert bool(derived_fields(names)) is expected
