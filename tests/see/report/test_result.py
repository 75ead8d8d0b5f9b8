"""The files that a run leaves behind."""

import json
from pathlib import Path

import numpy as np

from limberjack.episodes import Episode
from limberjack.mujoco.fingerprint import versions
from limberjack.see import report

_EPISODES = [Episode(4, None, np.array([0.25, 0.5])), Episode(5, "in_hand", np.array([1.0]))]


def test_a_result_lists_episodes_versions_and_fingerprint(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    report.write_result(path, {"task": "walk"}, _EPISODES, "abc")
    result = json.loads(path.read_text())
    assert result == {
        "task": "walk",
        "episodes": [
            {"seed": 4, "return": 0.75, "length": 2},
            {"seed": 5, "return": 1.0, "length": 1, "start": "in_hand"},
        ],
        "versions": versions(),
        "fingerprint": "abc",
    }


def test_a_result_is_valid_json_whatever_the_return(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    report.write_result(path, {}, [Episode(0, None, np.array([np.nan]))], "")
    assert "NaN" not in path.read_text()
    assert json.loads(path.read_text())["episodes"][0]["return"] is None
