"""Room on a device is more than what the CPU needs."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.gpu.sizes import measured
from limberjack.rl.action_specs import bounds_to_try

from .compared import copy_to_device, loaded
from .planned import PLANNED, actions_of


def test_there_is_room_for_the_contacts_and_constraints_of_random_actions() -> None:
    for domain, task in (("humanoid", "walk"), ("stacker", "stack_4"), ("cartpole", "balance")):
        sizes = measured(suite.load(domain, task, {"random": 0}))
        environment = suite.load(domain, task, {"random": 7})
        random, most, contacts = np.random.RandomState(7), 0, 0
        environment.reset()
        for _ in range(100):
            environment.step(random.uniform(*bounds_to_try(environment.action_spec())))
            data = environment.physics.data._data
            most, contacts = max(most, data.nefc), max(contacts, data.ncon)
        assert most < sizes.njmax
        assert contacts < sizes.nconmax
        assert sizes.nconmax % 8 == sizes.njmax % 8 == 0


@pytest.mark.gpu
@pytest.mark.parametrize(("domain", "task"), PLANNED)
def test_there_is_room_on_a_device_for_what_the_planner_does(domain: str, task: str) -> None:
    torch = pytest.importorskip("torch", reason="needs the extra 'gpu'")
    pytest.importorskip("mujoco_warp", reason="needs the extra 'gpu'")
    seed, _ = PLANNED[domain, task]
    # One row: no other row's room for contacts is left to it.
    batch = suite.load_batch(domain, task, 1, 1, seed=seed)
    envs = loaded(domain, task, 1)
    batch.reset()
    envs.reset()
    for action in actions_of(domain, task):
        copy_to_device(batch, envs)  # open loop, the device would leave the planner's motion
        envs.step(torch.from_numpy(action[None]))
        batch.step(action[None])
    assert envs.overflows == 0
    envs.close()
    batch.close()
