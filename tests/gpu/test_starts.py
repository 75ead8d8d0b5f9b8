"""Starts of a device are those of the CPU, rounded to float32."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.gpu.starts import Starts
from limberjack.rl.randomize import scale

_TASKS = [
    ("humanoid", "walk", {}),  # late readings
    ("manipulator", "bring_ball", {}),  # poses of bodies that never move, and rejection
    ("lqr", "lqr_6_2", {}),  # fields drawn for each seed
    ("cheetah", "run", {"randomize": {"body_mass": scale(0.5, 2)}}),  # and constants of the model
]
_SEEDS = [*range(70), 3]  # more than are drawn at once; one of them twice


@pytest.mark.parametrize(("domain", "task", "kwargs"), _TASKS)
def test_a_start_is_the_first_episode_of_its_seed(domain: str, task: str, kwargs: dict) -> None:
    environment = suite.load(domain, task, environment_kwargs=kwargs)
    names = environment._saved_fields()
    derived = ("body_subtreemass",) if "body_mass" in names else ()
    starts = Starts(environment, ("sensordata",), (*names, *derived))
    rows = starts.of_rows(starts.draw(_SEEDS))
    batch = suite.load_batch(domain, task, len(_SEEDS), 1, environment_kwargs=kwargs)
    batch.reset(seeds=_SEEDS)
    simulation = batch.physics.simulation
    assert [part.name for part in starts.parts if part.kind == "late"] == (
        ["sensordata"] if batch.single.model.nsensordata else []
    )
    for part in starts.parts:
        read = simulation.model_field if part.kind == "model" else simulation.data_field
        values, _ = read(part.name)
        np.testing.assert_array_equal(rows[part.name], np.float32(values), part.name)
    starts.close()


def test_the_default_row_is_the_models_default_state() -> None:
    environment = suite.load("humanoid", "walk")
    starts = Starts(environment, ("sensordata",), ())
    row = starts.of_rows(starts.default()[None])
    np.testing.assert_array_equal(row["qpos"][0], np.float32(environment.physics.model.qpos0))
    assert not row["qvel"].any()
    assert not row["sensordata"].any()
