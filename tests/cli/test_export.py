"""`limberjack export`; tests/policies/test_exporting.py exports models."""

import sys
from pathlib import Path
from typing import Any

import pytest

from limberjack.policies import mlp

from .conftest import invoke


def test_mistakes_are_one_line_and_write_nothing(tmp_path: Path) -> None:
    out = str(tmp_path / "out.safetensors")
    for arguments, message in (
        (["random"], "policy is 'random'; expected sb3:PATH, a model to export"),
        (["sb3:none.zip", "--task", "walker"], "got walker without a task; choose one of: run,"),
        (["sb3:none.zip", "--task", "walker/wlak"], "Did you mean 'walk'?"),
        (["sb3:none.zip"], "policy 'sb3:none.zip': "),
    ):
        result = invoke("export", arguments[0], out, *arguments[1:])
        assert result.exit_code == 2
        assert message in result.stderr
        assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_exported_model_is_played_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baselines: Any = pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    sb3: Any = pytest.importorskip("limberjack.sb3", reason="needs the extra 'sb3'")
    monkeypatch.setitem(sys.modules, "gym", None)  # SB3 looks for it, and finds a folder of tests
    envs = sb3.make_vec_env("walker", "walk", 2, seed=0, num_threads=1)
    baselines.PPO("MlpPolicy", envs, device="cpu", n_steps=8, batch_size=16).save(
        tmp_path / "m.zip"
    )
    name, out = f"sb3:{tmp_path / 'm.zip'}", tmp_path / "of mine.safetensors"
    arguments = ["--task", "walker/walk", "--action-repeat", "2"]
    result = invoke("export", name, str(out), *arguments)
    assert (result.exit_code, result.stdout) == (0, f"{out}: --policy 'mlp:{out}'\n")
    assert result.stderr.startswith(f"limberjack: policy {name!r} is a pickle, and loading it runs")
    assert mlp.load(out).card.title == "walker walk"
    played = invoke("run", "walker", "walk", "--policy", f"mlp:{out}", "--time-limit", "0.1")
    assert played.exit_code == 0, played.stderr
