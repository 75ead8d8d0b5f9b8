"""The benchmark of a GPU runs its checks without one, and continues a file of results."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

pytestmark = pytest.mark.gpu
pytest.importorskip("mujoco_warp", reason="needs the extra 'gpu'")


def test_without_a_gpu_it_says_so_and_writes_results_as_they_come(tmp_path: Path) -> None:
    file = tmp_path / "gpu.json"
    done = run_benchmark("gpu.py", "--seconds", "0.01", "--device", "cuda:99", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "No GPU: device is 'cuda:99', " in done.stdout
    (first,) = json.loads(file.read_text(encoding="utf-8"))["results"]
    assert first["num_envs"] == 8
    assert first["steps_per_second"] > 0
    done = run_benchmark("gpu.py", "--seconds", "0.01", "--device", "cpu", "--json", str(file))
    again = json.loads(file.read_text(encoding="utf-8"))["results"]
    assert again[0] == first
    assert len(again) == 2
