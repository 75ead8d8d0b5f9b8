"""Devices are refused in one sentence that says what to do."""

from typing import Any

import pytest

from .on_device import torch

pytestmark = pytest.mark.gpu
backend: Any = pytest.importorskip("limberjack.gpu.backend")
_NO_CUDA = pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a CUDA device")


def test_the_processor_is_a_device() -> None:
    assert backend.device_of("cpu") == torch.device("cpu")
    assert backend.device_of(torch.device("cpu")) == torch.device("cpu")


@pytest.mark.parametrize(
    ("name", "message"),
    [("tpu", "device is 'tpu'; expected 'cuda:0'"), (None, "device is None"), ("mps", "runs on")],
)
def test_other_names_are_refused(name: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        backend.device_of(name)


@_NO_CUDA
def test_without_cuda_the_message_says_what_to_install() -> None:
    with pytest.raises(ValueError, match=r"'cuda:0', but PyTorch .* finds no CUDA device: install"):
        backend.device_of("cuda:0")
    with pytest.raises(ValueError, match="install NVIDIA's driver and PyTorch for CUDA"):
        backend.devices()


def test_a_number_beyond_the_last_device_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(ValueError, match="this machine has 2 CUDA devices"):
        backend.device_of("cuda:2")


def test_a_driver_that_is_too_old_for_warp_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setattr(backend.warp, "get_cuda_devices", list)
    with pytest.raises(ValueError, match=r"Warp .* cannot: install a newer driver"):
        backend.device_of("cuda:0")
