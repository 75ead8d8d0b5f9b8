"""Rows of numbers are written where a mask is set, and read back."""

from typing import Any

import numpy as np
import pytest

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
gpu: Any = pytest.importorskip("limberjack.gpu.vector")


def test_rows_of_a_mask_are_written_and_the_others_left_alone() -> None:
    envs = gpu.load_vector("manipulator", "bring_ball", 3, device="cpu", seed=0)
    envs.reset()
    rows, batch = envs.batch._rows, envs.batch
    before = as_numpy(rows.read()).copy()
    assert before.shape == (3, batch.starts.width)
    drawn = batch.starts.draw([0, 1, 2])
    for part in batch.starts.parts:
        if part.kind != "static":  # the others move, and are computed on the device
            columns = part.columns
            np.testing.assert_array_equal(before[:, columns], drawn[:, columns], part.name)
    new = batch.starts.draw([7, 8, 9])
    rows.write(torch.tensor([False, True, False]), torch.from_numpy(new))
    after = as_numpy(rows.read())
    np.testing.assert_array_equal(after[1], new[1])
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    rows.write_state(torch.tensor([True, False, False]), torch.from_numpy(batch.starts.default()))
    after = batch.starts.of_rows(as_numpy(rows.read()))
    assert not after["qpos"][0, :8].any()
    kept = batch.starts.of_rows(before)
    for name in ("body_pos", "geom_xpos"):  # the model's fields, and poses that follow from them
        np.testing.assert_array_equal(after[name][0], kept[name][0])
    envs.close()
