"""The identity that must match to load a state elsewhere: MuJoCo's minor version and the model."""

import mujoco
import pytest

from limberjack import mujoco as mujoco_layer
from limberjack import suite
from limberjack.mujoco.identity import identity


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
