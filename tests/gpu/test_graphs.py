"""Recorded sequences of kernels give the bits of the sequences themselves."""

from typing import Any

import numpy as np
import pytest

from .on_device import torch

pytestmark = pytest.mark.gpu
graphs: Any = pytest.importorskip("limberjack.gpu.graphs")
backend: Any = pytest.importorskip("limberjack.gpu.backend")


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

    recorded = graphs.Graphs("cpu", uses_graphs=True)
    for expected in range(1, 6):
        recorded.run("add", body)
        np.testing.assert_array_equal(numbers.numpy(), expected)
    assert len(calls) == 2
    plain = graphs.Graphs("cpu", uses_graphs=False)
    for _ in range(3):
        plain.run("add", body)
    assert len(calls) == 5
    assert torch is not None
