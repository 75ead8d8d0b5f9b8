"""Results of a physics' own methods, recorded as they are called."""

from typing import Any

import numpy as np

from limberjack import mujoco
from limberjack.rl.batch_measurements import MEASUREMENT, measurements_of

_BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


class _Physics(mujoco.Physics):
    def height(self) -> Any:
        return self.data.qpos[2]

    def twice(self, factor: float = 2) -> Any:
        return factor * self.height()

    def live(self) -> Any:
        return self.data.qpos

    def names(self) -> list[str]:
        return ["ball"]

    @staticmethod
    def is_static() -> bool:
        return True

    def velocity(self) -> Any:
        return super().velocity()


def test_numbers_and_arrays_are_recorded_in_the_order_of_the_calls() -> None:
    physics = _Physics.from_xml_string(_BALL)
    measured = measurements_of(physics)
    physics.data.qpos[2] = 0.5
    assert physics.twice(factor=3) == 1.5
    assert physics.is_static()
    assert physics.names() == ["ball"]
    physics.velocity()  # of every physics
    assert [(name, value.item()) for name, value in measured.items()] == [
        ("physics.height()", 0.5),
        ("physics.twice()", 1.5),
        ("physics.is_static()", True),
    ]
    assert all(name.startswith(MEASUREMENT) for name in measured)


def test_each_call_is_recorded_with_a_copy() -> None:
    physics = _Physics.from_xml_string(_BALL)
    measured = measurements_of(physics)
    for height in (1.0, 2.0):
        physics.data.qpos[2] = height
        physics.live()
    heights = {name: value[2] for name, value in measured.items()}
    assert heights == {"physics.live()": 1.0, "physics.live(), call 2,": 2.0}
    measured.clear()
    physics.live()
    assert list(measured) == ["physics.live()"]


def test_another_physics_is_not_recorded() -> None:
    physics, other = (_Physics.from_xml_string(_BALL) for _ in range(2))
    measured = measurements_of(physics)
    np.testing.assert_array_equal(other.live()[:3], 0)
    assert not measured
