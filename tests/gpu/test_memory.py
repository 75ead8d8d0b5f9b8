"""A batch that does not fit is refused with the figures."""

from typing import Any

import pytest

from .on_device import torch

pytestmark = pytest.mark.gpu
memory: Any = pytest.importorskip("limberjack.gpu.memory")


def test_what_fits_passes_and_what_does_not_is_refused_with_the_number_that_would(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = torch.device("cpu")
    assert memory.available(device) > 0
    monkeypatch.setattr(memory, "available", lambda _: 1e9)
    memory.check(100, 9_000_000, device)
    with pytest.raises(MemoryError, match=r"takes 9\.0 GB on cpu, where 1\.0 GB are free: at most"):
        memory.check(1000, 9_000_000, device)
