"""Random joint positions are dm_control's, draw by draw."""

import numpy as np
import pytest

from . import models, twins
from .oracle import BOTH
from .same import assert_same_pair

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("model", models.ODD_JOINTS)
def test_random_joints_take_the_same_draws(model: str) -> None:
    for seed in range(20):
        ends = []
        twin = twins.TwinPhysics(
            *(
                package("mujoco").Physics.from_xml_string(models.ODD_JOINTS[model])
                for package in BOTH
            ),
            where=f"{model}, seed {seed}",
        )
        for package, physics in zip(BOTH, twin.both, strict=True):
            random = np.random.RandomState(seed)
            randomizers = package("suite.utils.randomizers")
            for _ in range(3):
                randomizers.randomize_limited_and_rotational_joints(physics, random)
            ends.append(random.random_sample())
        twin.assert_same_state()
        assert_same_pair(ends, f"{twin.where}: next draw")


def test_random_joints_draw_from_numpys_own_stream_by_default() -> None:
    twin = twins.TwinPhysics(
        *(
            package("mujoco").Physics.from_xml_string(
                models.ODD_JOINTS["each type, limited and not"]
            )
            for package in BOTH
        )
    )
    state = np.random.get_state()
    for package, physics in zip(BOTH, twin.both, strict=True):
        np.random.seed(17)
        package("suite.utils.randomizers").randomize_limited_and_rotational_joints(physics)
    np.random.set_state(state)
    twin.assert_same_state()


def test_random_limited_quaternions_are_the_same() -> None:
    for seed in range(50):
        quaternions = [
            package("suite.utils.randomizers").random_limited_quaternion(
                np.random.RandomState(seed), 0.1 * seed
            )
            for package in BOTH
        ]
        assert_same_pair(quaternions, f"seed {seed}")
