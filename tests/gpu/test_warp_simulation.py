"""A simulation on a device: MuJoCo's names and shapes, the CPU's contacts, recorded kernels."""

from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.gpu.sizes import Sizes

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
warp_simulation: Any = pytest.importorskip("limberjack.gpu.warp_simulation")
tensors: Any = pytest.importorskip("limberjack.gpu.tensors")
backend: Any = pytest.importorskip("limberjack.gpu.backend")

_SIZES = Sizes(nconmax=16, njmax=64)
_CAPSULE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1" {plane}/>
    <body pos="0 0 {height}" euler="{euler}">
      <freejoint/>
      <geom type="capsule" size=".05" fromto="0 0 -.25 0 0 .25"/>
    </body>
  </worldbody>
</mujoco>
"""
_BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="3 4 {height}">
      <freejoint/>
      <geom size=".1"/>
    </body>
  </worldbody>
</mujoco>
"""


def _simulation(domain: str, task: str, rows: int = 3, **kwargs: Any) -> tuple[Any, Any]:
    environment = suite.load(domain, task, {"random": 0})
    fields = kwargs.pop("own_fields", environment._saved_fields())
    model = environment.physics.model
    made = warp_simulation.WarpSimulation(model, rows, "cpu", fields, _SIZES, uses_graphs=False)
    return made, environment.physics


def test_fields_have_mujocos_shapes_with_a_leading_axis_of_rows() -> None:
    simulation, physics = _simulation("cheetah", "run")
    for name in ("qpos", "xmat", "xpos", "geom_xmat", "cvel", "subtree_com", "sensordata", "qacc"):
        field, has_rows = simulation.data_field(name)
        assert has_rows
        assert isinstance(field, tensors.DeviceArray)
        assert tuple(field.shape) == (3, *getattr(physics.data, name).shape), name
    with pytest.raises(AttributeError, match="no array 'ncon'"):
        simulation.data_field("ncon")


def test_a_physics_reads_names_and_refuses_what_a_device_lacks() -> None:
    simulation, physics = _simulation("cheetah", "run")
    seen = physics.seen_through(simulation)
    assert tuple(seen.named.data.xpos["torso", ["x", "z"]].shape) == (3, 2)
    assert seen.num_envs == 3
    with pytest.raises(AttributeError, match="has no 'ncon'"):
        _ = seen.data.ncon


def test_half_a_step_and_whole_steps_follow_the_cpu() -> None:
    for domain, task in (("cheetah", "run"), ("acrobot", "swingup")):  # Euler, Runge-Kutta
        simulation, physics = _simulation(domain, task)
        with simulation.scope():
            simulation.first_half()
            simulation.ctrl.fill_(0.5)
            simulation.advance(3)
            simulation.first_half()
        physics.reset()
        physics.set_control(np.full(physics.model.nu, 0.5))
        physics.step(3)
        for name in ("qpos", "qvel", "xpos", "sensordata"):
            found = as_numpy(simulation.data_field(name)[0])
            expected = np.broadcast_to(getattr(physics.data, name), found.shape)
            # float32 beside float64, three steps from the same state.
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4, err_msg=name)


def test_late_readings_survive_the_first_half_of_the_next_step() -> None:
    simulation, _ = _simulation("humanoid", "walk")
    readings = simulation.data_field("sensordata")[0]
    assert simulation.late_columns.any()
    assert not simulation.late_columns.all()
    with simulation.scope():
        simulation.first_half()
        simulation.advance(2)
        before = as_numpy(readings).copy()
        simulation.first_half()
    late = simulation.late_columns
    assert before[:, late].any()
    np.testing.assert_array_equal(as_numpy(readings)[:, late], before[:, late])
    assert not as_numpy(simulation.live("sensordata"))[:, late].any()  # Warp has cleared them
    early = as_numpy(simulation.live("sensordata"))[:, ~late]
    np.testing.assert_array_equal(as_numpy(readings)[:, ~late], early)


def test_rows_have_model_fields_of_their_own() -> None:
    simulation, _ = _simulation("cheetah", "run", own_fields=("body_mass", "opt.gravity"))
    simulation.own["opt.gravity"][1] = 0.0
    with simulation.scope():
        simulation.first_half()
        simulation.advance(1)
    heights = as_numpy(simulation.live("qvel"))[:, 1]
    assert heights[0] == heights[2] < -0.05
    assert abs(heights[1]) < 1e-6
    field, has_rows = simulation.model_field("body_mass")
    assert has_rows
    assert field.data_ptr() == simulation.own["body_mass"].data_ptr()


def test_shared_fields_of_the_model_are_constants_and_integers_stay_in_numpy() -> None:
    simulation, physics = _simulation("cheetah", "run")
    sizes, has_rows = simulation.model_field("geom_size")
    assert not has_rows
    assert simulation.model_field("geom_size")[0] is sizes
    np.testing.assert_array_equal(as_numpy(sizes), np.float32(physics.model.geom_size))
    assert isinstance(simulation.model_field("jnt_qposadr")[0], np.ndarray)
    assert simulation.model_field("nq")[0] == physics.model.nq


def test_constraints_without_room_are_counted() -> None:
    environment = suite.load("cheetah", "run", {"random": 0})
    made = warp_simulation.WarpSimulation(
        environment.physics.model, 2, "cpu", (), Sizes(nconmax=4, njmax=2), uses_graphs=False
    )
    with made.scope():
        made.live("qpos")[1, 1] = -0.3  # sunk into the floor
        made.first_half()
        assert not made.take_overflow().any()
        made.advance(1)
        np.testing.assert_array_equal(as_numpy(made.take_overflow()), [False, True])
        made.live("qpos")[1, 1] = 3.0
        made.first_half()
        made.advance(1)
        assert not made.take_overflow().any()


def test_memory_per_row_grows_with_the_room_for_constraints() -> None:
    model = suite.load("cheetah", "run").physics.model
    small, large = (
        warp_simulation.bytes_per_row(model, (), Sizes(nconmax=16, njmax=rows)) for rows in (32, 64)
    )
    assert 5_000 < small < large
    assert torch is not None


def _forward(physics: mujoco.Physics) -> Any:
    """A simulation of two rows on the device, in the state in which the model begins."""
    sizes = Sizes(nconmax=8, njmax=32)
    made = warp_simulation.WarpSimulation(physics.model, 2, "cpu", (), sizes, uses_graphs=False)
    with made.scope():
        made.first_half()
    return made


@pytest.mark.parametrize(
    ("euler", "height"), [("0 5 0", 0.29), ("20 0 10", 0.28), ("0 -29 30", 0.26), ("60 0 0", 0.16)]
)
@pytest.mark.parametrize("plane", ["", 'euler="0 3 0"'])
def test_the_first_tangent_points_along_the_capsule(euler: str, height: float, plane: str) -> None:
    xml = _CAPSULE.format(euler=euler, height=height, plane=plane)
    physics = mujoco.Physics.from_xml_string(xml)
    physics.forward()
    made = _forward(physics)
    contact = made._data.contact
    (expected,) = physics.data._data.contact.frame
    for row in range(2):
        found = contact.frame.numpy()[contact.worldid.numpy() == row][0]
        np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)  # float32


@pytest.mark.parametrize(("depth", "presses"), [(-1e-3, False), (2e-7, False), (2e-6, True)])
def test_geoms_touch_if_they_are_deeper_than_float32_rounds(depth: float, presses: bool) -> None:
    physics = mujoco.Physics.from_xml_string(_BALL.format(height=0.1 - depth))
    made = _forward(physics)
    assert (made._data.nefc.numpy() > 0).tolist() == [presses, presses]


def test_a_sequence_runs_once_is_recorded_and_is_replayed() -> None:
    warp = backend.warp
    numbers = warp.zeros(3, dtype=float, device="cpu")
    calls = []

    def body() -> None:
        calls.append(1)
        warp.launch(_add_one, dim=3, inputs=[numbers], device="cpu")

    @warp.kernel
    def _add_one(values: warp.array(dtype=float)):  # pyright: ignore[reportInvalidTypeForm]
        row = warp.tid()
        values[row] = values[row] + 1.0

    recorded = warp_simulation._Graphs("cpu", uses_graphs=True)
    for expected in range(1, 6):
        recorded.run("add", body)
        np.testing.assert_array_equal(numbers.numpy(), expected)
    assert len(calls) == 2
    plain = warp_simulation._Graphs("cpu", uses_graphs=False)
    for _ in range(3):
        plain.run("add", body)
    assert len(calls) == 5
