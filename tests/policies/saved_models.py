"""A stand-in for `limberjack.sb3`, which needs PyTorch: it reads a model that is a text file."""

import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

__all__ = ["NAME", "install", "without_sb3"]

NAME = "limberjack.sb3"


class _SavedPolicy:
    """Acts with the number in the file, for humanoids only."""

    def __init__(self, files: Mapping[Path, bytes], environment: Any) -> None:
        self.files = files
        self._number = float(next(iter(files.values())))
        if environment.action_spec().shape != (21,):
            raise ValueError("the model's actions have shape (21,); the task's have another")

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        assert {len(values) for values in observations.values()} == {64}
        return np.full((64, 21), self._number) * np.arange(64)[:, None] / 64


def install(monkeypatch: pytest.MonkeyPatch, directory: Path) -> str:
    """Puts the stand-in in the place of the module; returns the name of a model that acts."""
    module = ModuleType(NAME)
    module.SavedPolicy = _SavedPolicy  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, NAME, module)
    monkeypatch.setattr("limberjack.sb3", module, raising=False)
    path = directory / "model.zip"
    path.write_text("0.5")
    return f"sb3:{path}"


def without_sb3(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets importing `limberjack.sb3` fail, as where Stable-Baselines3 is not installed."""
    imported = [name for name in sys.modules if name.startswith("stable_baselines3.")]
    for name in ("stable_baselines3", *imported):
        monkeypatch.setitem(sys.modules, name, None)
    for name in (NAME, "limberjack.adapters.sb3"):  # imported before, where it is installed
        monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.delattr(name, raising=False)
