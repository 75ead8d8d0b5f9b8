"""The arm's figures, beside those of the compiled models."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.arm.geometry import GEOMETRY, ArmGeometry


def test_the_figures_are_those_of_each_model_with_a_peg() -> None:
    for task in ("bring_peg", "insert_peg"):
        model = suite.load("manipulator", task, {"random": 0}).physics.model.ptr
        assert ArmGeometry.of(model) == GEOMETRY


@pytest.mark.parametrize("angles", [np.zeros(4), np.array([0.3, -1.0, 0.7, 2.0])])
def test_the_links_lead_from_the_base_to_the_hand(angles: np.ndarray) -> None:
    physics = suite.load("stacker", "stack_2", {"random": 0}).physics
    data = physics.named.data
    with physics.reset_context():
        data.qpos[["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist"]] = angles
    turned = np.cumsum(angles)
    lengths = np.array([*GEOMETRY.lengths, GEOMETRY.grasp])
    x, z = -(lengths * np.sin(turned)).sum(), (lengths * np.cos(turned)).sum()
    # Sines and cosines round.
    expected = [x, GEOMETRY.base_height + z]
    np.testing.assert_allclose(data.site_xpos["grasp", ["x", "z"]], expected, atol=1e-12)
