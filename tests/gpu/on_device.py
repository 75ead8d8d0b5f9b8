"""torch, for tests that skip where the extra `gpu` is not installed."""

from typing import Any

import pytest

__all__ = ["as_numpy", "torch"]

torch: Any = pytest.importorskip("torch", reason="needs the extra 'gpu'")
pytest.importorskip("mujoco_warp", reason="needs the extra 'gpu'")


def as_numpy(value: Any) -> Any:
    """A tensor's values."""
    return value.as_subclass(torch.Tensor).cpu().numpy()
