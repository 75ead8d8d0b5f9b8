"""Integer fields of a model are fixed, or can be written where the model stays valid."""

import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.wrapper.integer_fields import (
    checked_field,
    empty_model,
    fixed_field,
    is_checked,
    is_structure,
)
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import walker

_TYPE = mujoco.mjtGeom
_ASSETS = """
  <asset>
    <mesh name="small" vertex="0 0 0  .4 0 0  0 .4 0  0 0 .4"/>
    <mesh name="large" vertex="0 0 0  .9 0 0  0 .9 0  0 0 .9  -.2 -.2 -.2"/>
    <hfield name="hills" nrow="5" ncol="5" size=".6 .6 .4 .2"/>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 0 0" width="32" height="192"/>
    <texture name="flat" type="2d" builtin="checker" rgb1="0 1 0" width="20" height="30"/>
    <texture name="cube" type="cube" builtin="flat" rgb1="0 0 1" width="16" height="16"/>
    <material name="flat" texture="flat"/>
    <material name="cube" texture="cube"/>
  </asset>
"""
# The geom {0} and its neighbours: one in its body, one in another body, the floor.
_TWO_BODIES = """
<mujoco>
  {1}
  <worldbody>
    <geom type="plane" size="3 3 .1"/>
    <geom name="post" type="box" size=".1 .1 .5" pos="1 0 .5"/>
    <body name="first" pos="0 0 1">
      <freejoint/>
      <inertial pos=".1 0 0" mass="1" diaginertia=".1 .2 .25"/>
      <geom name="it" {0} pos=".1 .2 0" euler="10 20 30"/>
      <geom name="beside" type="sphere" size=".1" pos="-.5 0 0"/>
    </body>
    <body name="second" pos="1 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia=".1 .2 .25"/>
      <geom name="other" type="capsule" size=".1 .3"/>
      <geom type="sphere" size=".1" pos="0 .4 0"/>
    </body>
  </worldbody>
</mujoco>
"""
_SHAPES = {
    "sphere": 'type="sphere" size=".3"',
    "capsule": 'type="capsule" size=".2 .3"',
    "ellipsoid": 'type="ellipsoid" size=".1 .2 .4" fluidshape="ellipsoid"',
    "cylinder": 'type="cylinder" size=".3 .1"',
    "box": 'type="box" size=".4 .1 .2"',
    "small mesh": 'type="mesh" mesh="small"',
    "large mesh": 'type="mesh" mesh="large"',
    "height field": 'type="hfield" hfield="hills"',
}


def _with_shape(shape: str) -> Physics:
    return Physics.from_xml_string(_TWO_BODIES.format(_SHAPES[shape], _ASSETS))


def _model() -> wrapper.MjModel:
    return _with_shape("box").model


def _contacts(physics: Physics) -> list[tuple[float, ...]]:
    data = physics.data.ptr
    found = [(*c.geom.tolist(), c.dist, *c.pos.tolist(), *c.frame.tolist()) for c in data.contact]
    return sorted(found)


def test_a_field_is_fixed_or_checked_or_may_have_any_value() -> None:
    model = empty_model()
    fields = {n: getattr(model, n) for n in dir(model) if not n.startswith("_")}
    for name, field in fields.items():
        if not isinstance(field, np.ndarray):
            continue
        if field.dtype.kind == "f":
            assert not is_structure(name), name
        if field.dtype.kind == "i" and name.endswith(("id", "adr", "num", "_type")):
            assert is_structure(name), name
        if is_checked(name):
            assert is_structure(name), name
    assert not is_structure("geom_contype")
    assert is_structure("flexedge_rigid")


@pytest.mark.parametrize(("before", "after"), list(itertools.permutations(_SHAPES, 2)))
def test_a_geom_of_another_type_has_the_contacts_of_a_model_compiled_with_it(
    before: str, after: str
) -> None:
    changed, compiled = _with_shape(before), _with_shape(after)
    ours, theirs = changed.named.model, compiled.named.model
    for name in ("geom_pos", "geom_quat", "geom_size"):  # the compiler centres a mesh
        getattr(ours, name)["it"] = getattr(theirs, name)["it"]
    if {before, after} == {"height field", "large mesh"}:  # no number is valid for both
        ours.geom_type["it"] = _TYPE.mjGEOM_SPHERE
    if theirs.geom_dataid["it"] >= 0:
        ours.geom_dataid["it"] = theirs.geom_dataid["it"]
    ours.geom_type["it"] = theirs.geom_type["it"]
    for name in ("geom_rbound", "geom_aabb"):
        # MuJoCo derives a mesh's box in another order of operations when it compiles.
        np.testing.assert_allclose(
            getattr(ours, name)["it"], getattr(theirs, name)["it"], rtol=0, atol=1e-6
        )
    random = np.random.RandomState(0)
    touched = 0
    for _ in range(60):
        pose = random.uniform(-0.6, 0.6, 14)
        pose[[2, 9]] += 0.6
        for physics in (changed, compiled):
            physics.data.qpos[:] = pose
            physics.forward()
        assert _contacts(changed) == _contacts(compiled)
        it = changed.model.name2id("it", "geom")
        touched += any(it in contact[:2] for contact in _contacts(changed))
    assert touched > 5


def test_a_plane_in_the_world_can_become_a_box_and_a_plane_again() -> None:
    physics = _with_shape("sphere")
    # The box reaches 0.1 metres above its centre.
    heights = {_TYPE.mjGEOM_PLANE: 0.0, _TYPE.mjGEOM_BOX: 0.1}
    for kind in (_TYPE.mjGEOM_PLANE, _TYPE.mjGEOM_BOX, _TYPE.mjGEOM_PLANE):
        physics.model.geom_type[0] = kind
        physics.reset()
        physics.step(2000)
        contacts = physics.data.contact
        ground = contacts.pos[(contacts.geom == 0).any(axis=-1), 2]
        assert ground.size
        np.testing.assert_allclose(ground, heights[kind], rtol=0, atol=0.01)


def test_a_change_of_type_keeps_everything_else_that_a_program_has_set() -> None:
    model = _model()
    model.body_mass[1] = 7.0
    model.geom_rbound[4] = 9.0
    before = {n: np.array(getattr(model, n)) for n in ("body_subtreemass", "body_invweight0")}
    model.geom_type[2] = _TYPE.mjGEOM_ELLIPSOID
    assert model.body_mass[1] == 7.0
    assert model.geom_rbound[4] == 9.0
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(model, name), values)


_EVERY_WAY: dict[str, Callable[[Any, Any], object]] = {
    "item": lambda m, n: m.cam_mode.__setitem__(0, n),
    "slice": lambda m, n: m.cam_mode[:1].__setitem__(0, n),
    "all": lambda m, n: m.cam_mode.__setitem__(slice(None), n),
    "list": lambda m, n: m.cam_mode.__setitem__([0], n),
    "mask": lambda m, n: m.cam_mode.__setitem__(m.cam_mode >= 0, n),
    "attribute": lambda m, n: setattr(m, "cam_mode", np.full(m.ncam, n)),
    "fill": lambda m, n: m.cam_mode.fill(n),
    "put": lambda m, n: m.cam_mode.put([0], [n]),
    "np.put": lambda m, n: np.put(m.cam_mode, [0], [n]),
    "np.copyto": lambda m, n: np.copyto(m.cam_mode, n),
    "np.place": lambda m, n: np.place(m.cam_mode, m.cam_mode >= 0, [n]),
    "np.putmask": lambda m, n: np.putmask(m.cam_mode, m.cam_mode >= 0, n),
    "flat": lambda m, n: m.cam_mode.flat.__setitem__(0, n),
    "all flat": lambda m, n: setattr(m.cam_mode, "flat", n),
    "out": lambda m, n: np.multiply(np.ones(m.ncam, int), n, out=m.cam_mode, casting="unsafe"),
    "at": lambda m, n: np.maximum.at(m.cam_mode, [0], n),
    "in place": lambda m, n: m.cam_mode.__iadd__(n - m.cam_mode),
    "reshaped": lambda m, n: m.cam_mode.reshape(-1, 1).__setitem__((0, 0), n),
    "setfield": lambda m, n: m.cam_mode.setfield(n, np.int32),
}


@pytest.mark.parametrize("way", _EVERY_WAY)
def test_every_way_of_writing_is_checked(way: str) -> None:
    model = suite.load("cartpole", "swingup").physics.model
    write = _EVERY_WAY[way]
    write(model, 3)
    assert model._official.cam_mode[0] == 3
    before = model.to_bytes()
    with pytest.raises(
        ValueError, match=r"cam_mode\[\d\] cannot be 9: expected .* 0 to 4; nothing"
    ):
        write(model, 9)
    assert model.to_bytes() == before


def test_named_access_is_checked() -> None:
    physics = _with_shape("box")
    physics.named.model.geom_type["it"] = _TYPE.mjGEOM_CYLINDER
    physics.named.model.geom_type[["it", "beside"]] = _TYPE.mjGEOM_SPHERE
    assert physics.model.geom_type[2] == physics.model.geom_type[3] == _TYPE.mjGEOM_SPHERE
    with pytest.raises(ValueError, match=r"geom_type\[2\] cannot be 106"):
        physics.named.model.geom_type["it"] = _TYPE.mjGEOM_SKIN


@pytest.mark.parametrize(
    ("field", "index", "value", "expected"),
    [
        (
            "geom_type",
            2,
            7,
            r"a geom_dataid from 0 to 1 .*it is -1: write geom_dataid",
        ),
        ("geom_type", 2, 1, r"a geom_dataid from 0 to 0 .* a height field"),
        ("geom_type", 2, 0, "a plane cannot be attached to body 1, which moves"),
        ("geom_type", 2, 8, "change the MJCF and compile it again"),
        ("geom_type", 2, 100, "a type that collides"),
        ("geom_type", 2, -1, "a type that collides"),
        ("geom_type", 3, 6, r"3 positive sizes.*write geom_size first"),
        ("geom_dataid", 2, 2, "the number of a mesh or height field, below 2"),
        ("geom_dataid", 2, -2, "-1 for none"),
        ("geom_matid", 1, 2, "the number of a material, of which the model has 2"),
        ("geom_condim", 1, 5, "1, 3, 4 or 6"),
        ("geom_sameframe", 2, 1, "expected 0: MuJoCo skips the transformation"),
        ("mat_texid", (0, 1), 3, "the number of a texture"),
        ("tex_height", 1, 5000, r"30000.*of 23016|end at .* of .*smaller sizes"),
        ("tex_width", 0, 100, r"six faces of width squared\) end at"),
        ("tex_width", 0, 0, "1 to 16384 pixels"),
        ("tex_nchannel", 0, 2, "3 or 4 channels"),
        ("tex_adr", 0, -1, "a texture within tex_data"),
    ],
)
def test_a_value_that_does_not_fit_the_model_is_refused_and_changes_nothing(
    field: str, index: Any, value: int, expected: str
) -> None:
    model = _model()
    before = model.to_bytes()
    with pytest.raises(ValueError, match=expected) as caught:
        getattr(model, field)[index] = value
    assert str(caught.value).startswith(f"{field}[")
    assert str(caught.value).endswith("nothing was changed")
    assert model.to_bytes() == before


def test_a_write_of_many_elements_is_refused_as_a_whole() -> None:
    model = _model()
    with pytest.raises(ValueError, match="geom_type"):
        model.geom_type[1:3] = [_TYPE.mjGEOM_SPHERE, _TYPE.mjGEOM_PLANE]
    assert model.geom_type[1] == _TYPE.mjGEOM_BOX
    with pytest.raises(OverflowError):
        model.geom_type[1] = 2**40


def test_a_texture_may_take_all_stored_bytes_and_no_more() -> None:
    model = _model()
    stored = model.tex_data.size
    flat, start = 1, int(model.tex_adr[1])
    rows = (stored - start) // (3 * 20)
    model.tex_height[flat] = rows
    with pytest.raises(ValueError, match="tex_height"):
        model.tex_height[flat] = rows + 1
    sky = 0
    model.tex_height[sky] = model.tex_width[sky]  # one face for all sides
    model.tex_width[sky] = 16
    assert wrapper.MjModel.from_byte_string(model.to_bytes()).tex_height[flat] == rows


def test_frames_can_be_declared_different_and_the_same_only_if_they_are() -> None:
    model = suite.load("walker", "walk").physics.model
    for name in ("geom_sameframe", "body_sameframe", "site_sameframe"):
        field = getattr(model, name)
        true = field.copy()
        field[:] = 0
        field[:] = true
        wrong = np.flatnonzero(true == 0)
        if wrong.size:
            with pytest.raises(ValueError, match=name):
                field[wrong[0]] = 1


def test_a_structural_field_names_itself_and_the_way_out_for_every_write() -> None:
    model = _model()
    for write in (
        lambda: model.geom_bodyid.__setitem__(0, 1),
        lambda: model.geom_bodyid.fill(1),
        lambda: model.geom_bodyid.flat.__setitem__(0, 1),
        lambda: np.copyto(model.geom_bodyid, 1),
        lambda: np.add(model.geom_bodyid, 1, out=model.geom_bodyid),
        lambda: setattr(model, "geom_bodyid", 1),
    ):
        with pytest.raises(ValueError, match=r"geom_bodyid is part .*structure.*change the MJCF"):
            write()


def test_a_shared_model_is_copied_before_a_checked_field_can_be_written() -> None:
    first, second = (suite.load("walker", "walk").physics.model for _ in range(2))
    field = first.cam_mode
    field[0] = 0
    assert first.cam_mode[0] == first._official.cam_mode[0] == field[0] == 0
    assert second.cam_mode[0] == 2


def test_a_cameras_target_and_an_actuators_kind_can_be_changed() -> None:
    physics = suite.load("walker", "walk").physics
    model = physics.model
    model.cam_targetbodyid[0], model.cam_mode[0] = model.name2id("torso", "body"), 3
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[:, 1] = -20.0
    physics.step(10)
    with pytest.raises(ValueError, match=r"actuator_gaintype\[0\] cannot be 2.*compile it again"):
        model.actuator_gaintype[0] = mujoco.mjtGain.mjGAIN_MUSCLE


def test_views_share_the_memory_of_the_official_model() -> None:
    official = _model().ptr
    assert np.shares_memory(checked_field(official, "geom_type"), official.geom_type)
    assert np.shares_memory(fixed_field(official, "geom_bodyid"), official.geom_bodyid)


_FUZZ = """
import numpy as np
from limberjack.mujoco import Physics, wrapper
from limberjack.rl.control import PhysicsError
from tests.mujoco.wrapper.test_integer_fields import crowded

physics = Physics.from_xml_string(crowded())
model, random = physics.model, np.random.RandomState({seed})
names = [n for n in dir(model._official) if not n.startswith("_")]
fields = [n for n in names if isinstance(getattr(model._official, n), np.ndarray)]
fields = [n for n in fields if getattr(model._official, n).dtype.kind in "iub"]
fields = [n for n in fields if getattr(model._official, n).size]
values = [-2, -1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 30, 32, 100, 106, 1000, 2**31 - 1, -(2**31)]
count = 0
for _ in range({writes}):
    name = fields[random.randint(len(fields))]
    field = getattr(model, name)
    value = values[random.randint(len(values))]
    before = model.to_bytes()
    try:
        field.flat[random.randint(field.size)] = value
    except (ValueError, OverflowError) as error:
        if not isinstance(error, OverflowError):  # NumPy's, of a number with too many bits
            assert name in str(error) or "Error setting single item" in str(error), error
        assert model.to_bytes() == before
        continue
    count += 1
    wrapper.MjModel.from_byte_string(model.to_bytes())
    physics.data.ctrl[:] = random.uniform(-1, 1, model.nu)
    try:
        physics.forward()
        physics.step(2)
    except PhysicsError:
        physics.reset()
    if {draws}:
        physics.render(24, 32, camera_id=random.randint(-1, model.ncam))
print(count)
"""


def crowded() -> str:
    """A model with something of nearly every kind."""
    return f"""
    <mujoco>
      {_ASSETS}
      <worldbody>
        <light type="spot" pos="0 0 3"/>
        <light type="point" pos="1 0 3"/>
        <geom type="plane" size="1 1 .1" material="flat"/>
        <geom type="box" size=".3 .2 .1" pos="3 0 0" material="cube"/>
        <geom type="mesh" mesh="small" pos="0 1 0"/>
        <geom name="hills" type="hfield" hfield="hills" pos="1 1 0"/>
        <geom type="mesh" mesh="large" pos="0 1 .5" contype="0" conaffinity="0"/>
        <camera name="still" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
        <camera mode="targetbody" target="x" pos="0 -3 1"/>
        <body name="x" pos="0 0 .3">
          <freejoint/>
          <geom name="one" type="box" size=".1 .1 .1" fluidshape="ellipsoid"/>
          <geom type="sphere" size=".1" pos=".2 0 0"/>
          <site name="one" size=".05 .05 .05"/>
          <camera mode="trackcom" pos="0 -1 1"/>
        </body>
        <body name="y" pos=".3 0 .6">
          <freejoint/>
          <geom name="two" type="capsule" size=".1 .1"/>
          <geom type="mesh" mesh="large"/>
          <site name="two" size=".05 .05 .05" pos="1 0 0"/>
        </body>
        <body name="z" pos=".3 .3 .9">
          <joint name="hinge"/>
          <geom name="three" type="ellipsoid" size=".1 .1 .1"/>
        </body>
        <flexcomp name="cloth" type="grid" dim="2" count="4 4 1" spacing=".1 .1 .1" pos="0 0 1"
            radius=".02" mass=".1">
          <contact selfcollide="none"/>
          <edge damping="1" equality="true"/>
        </flexcomp>
      </worldbody>
      <tendon><spatial name="rope"><site site="one"/><site site="two"/></spatial></tendon>
      <contact><pair geom1="one" geom2="two"/><pair geom1="two" geom2="hills"/></contact>
      <equality><connect body1="x" body2="y" anchor="0 0 0" active="false"/></equality>
      <actuator>
        <motor joint="hinge"/>
        <position joint="hinge" kp="1"/>
        <general tendon="rope" dyntype="integrator" actlimited="true" actrange="-1 1"/>
      </actuator>
      <sensor>
        <touch site="one"/>
        <rangefinder site="two"/>
        <distance geom1="one" geom2="three" cutoff="5"/>
        <camprojection site="one" camera="still"/>
      </sensor>
    </mujoco>
    """


@pytest.mark.parametrize("seed", [0, 1])
def test_no_write_that_is_accepted_ends_the_process(
    seed: int, run_script: Callable[..., str]
) -> None:
    script = _FUZZ.format(seed=seed, writes=1500, draws=False)
    assert int(run_script(script)) > 50


def test_no_write_that_is_accepted_ends_a_picture(run_script: Callable[..., str]) -> None:
    assert int(run_script(_FUZZ.format(seed=2, writes=200, draws=True))) > 10


class _Retyped(walker.PlanarWalker):
    """A walker whose start draws a camera's mode and the shape of a foot."""

    EPISODE_FIELDS = ("cam_mode", "geom_type", "geom_rbound", "geom_aabb", "bvh_aabb")

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        physics.model.cam_mode[0] = self.random.randint(2)
        kinds = [_TYPE.mjGEOM_CAPSULE.value, _TYPE.mjGEOM_CYLINDER.value]
        physics.named.model.geom_type["left_foot"] = self.random.choice(kinds)
        physics.after_reset()


def _retyped() -> control.Environment:
    physics = walker.Physics.from_xml_string(*walker.get_model_and_assets())
    return control.Environment(physics, _Retyped(move_speed=1, random=0), control_timestep=0.025)


def test_rows_of_a_batch_have_types_of_their_own() -> None:
    batch = BatchEnvironment.from_environment(_retyped(), 4, 1, seed=0)
    batch.reset()
    kinds = batch.physics.named.model.geom_type["left_foot"]
    assert len(set(kinds.tolist())) == 2
    actions = np.random.RandomState(1).uniform(-1, 1, (60, 6))
    for row in range(4):
        single = _retyped()
        single.task._random = np.random.RandomState(row)
        single.reset()
        assert single.physics.named.model.geom_type["left_foot"] == kinds[row]
        rows = BatchEnvironment.from_environment(_retyped(), 4, 1, seed=0)
        rows.reset()
        for action in actions:
            ours, theirs = single.step(action), rows.step(np.tile(action, (4, 1)))
            for name, value in ours.observation.items():
                np.testing.assert_array_equal(value, theirs.observation[name][row])


def test_values_of_rows_are_checked() -> None:
    batch = BatchEnvironment.from_environment(_retyped(), 3, 1, seed=0)
    batch.reset()
    model, simulation = batch.physics.model, batch.physics.simulation
    model.cam_mode[1, 0] = 3
    saved = simulation.save(None, ("cam_mode",))
    with pytest.raises(ValueError, match=r"cam_mode\[0\] cannot be 9"):
        model.cam_mode[:, 0] = [0, 9, 0]
    with pytest.raises(ValueError, match="geom_type of a row is read-only: only the task's"):
        model.geom_type[0, 0] = 2
    with pytest.raises(ValueError, match=r"cam_mode\[0\] cannot be 77"):
        simulation.set_fields({"cam_mode": np.full(2, 77)}, 1)
    with pytest.raises(ValueError, match=r"geom_type\[0\] cannot be 106"):
        simulation.set_fields({"geom_type": np.full(model.ngeom, 106)})
    with pytest.raises(ValueError, match="cam_mode"):
        simulation.load({**saved, "cam_mode": saved["cam_mode"] + 50})
    for name, value in simulation.save(None, ("cam_mode",)).items():
        np.testing.assert_array_equal(value, saved[name])
