"""Room on a device is more than what the CPU needs."""

import numpy as np

from limberjack import suite
from limberjack.gpu.sizes import measured
from limberjack.rl.action_specs import bounds_to_try


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
