"""Policy files with drawn weights, for tasks of the suite."""

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import mlp, networks

__all__ = ["bundle", "card_of", "drawn", "write"]


def drawn(*sizes: int, seed: int = 0) -> list[mlp.Layer]:
    """Layers of these sizes, whose outputs are of the size of 1."""
    stream = np.random.RandomState(seed)
    layers: list[mlp.Layer] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers.append((stream.randn(outputs, inputs) / np.sqrt(inputs), stream.randn(outputs)))
    return layers


def card_of(domain: str, task: str, **changes: Any) -> mlp.Card:
    """The card of a policy of a task, which acts every second control step."""
    environment = suite.load(domain, task, {"random": 0})
    spec = environment.action_spec()
    assert isinstance(spec, specs.BoundedArray)
    card = mlp.Card(
        layout=networks.layout_of(environment),
        low=tuple(np.broadcast_to(spec.minimum, spec.shape).tolist()),
        high=tuple(np.broadcast_to(spec.maximum, spec.shape).tolist()),
        action_repeat=2,
        domain=domain,
        task=task,
        algorithm="CrossQ",
        versions=versions(),
        fingerprint=fingerprint(environment.physics.model._official),
        scores=mlp.Scores(500.5, (450.0, 550.0), (1000, 1100)),
    )
    return dataclasses.replace(card, **changes)


def write(
    path: Path, domain: str = "walker", task: str = "walk", seed: int = 0, **changes: Any
) -> str:
    """Writes a policy of a task; returns its name."""
    card = card_of(domain, task, **changes)
    mlp.save(path, drawn(card.num_observations, 16, len(card.low), seed=seed), card)
    return f"mlp:{path}"


def bundle(monkeypatch: pytest.MonkeyPatch, folder: Path, *tasks: tuple[str, str]) -> None:
    """Lets the package have policies of these tasks, and no others."""
    monkeypatch.setattr(networks, "_FOLDER", folder)
    for domain, task in tasks:
        write(folder / f"{domain}-{task}.safetensors", domain, task)
