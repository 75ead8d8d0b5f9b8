"""The files that a run leaves behind."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from limberjack.episodes import Episode
from limberjack.mujoco.fingerprint import versions
from limberjack.see import report
from limberjack.see.report.result import as_result, check_folder

_EPISODES = [Episode(4, None, np.array([0.25, 0.5])), Episode(5, "in_hand", np.array([1.0]))]

_RUN = {"domain": "humanoid", "task": "walk", "policy": "zero"}


def test_a_result_lists_episodes_versions_and_fingerprint(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    report.write_result(path, as_result({"task": "walk"}, _EPISODES, "abc"))
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
    report.write_result(path, as_result({}, [Episode(0, None, np.array([np.nan]))], ""))
    assert "NaN" not in path.read_text()
    assert json.loads(path.read_text())["episodes"][0]["return"] is None


def test_an_empty_folder_and_that_of_an_earlier_run_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    check_folder(tmp_path, _RUN)
    (tmp_path / "result.json").write_text(json.dumps(_RUN))
    (tmp_path / "video.mp4").write_text("")
    check_folder(tmp_path, _RUN)


@pytest.mark.parametrize("name", _RUN)
def test_results_of_another_domain_task_or_policy_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(json.dumps({**_RUN, name: "other"}))
    with pytest.raises(ValueError, match=f"holds results with {name} 'other', and these have"):
        check_folder(tmp_path, _RUN)


@pytest.mark.parametrize("content", ["no JSON", "[]"])
def test_a_result_of_something_else_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(content)
    with pytest.raises(ValueError, match="holds results with domain None"):
        check_folder(tmp_path, _RUN)


def test_an_evaluation_is_refused(tmp_path: Path) -> None:
    (tmp_path / "episodes.jsonl").write_text("")
    with pytest.raises(ValueError, match="holds an evaluation: choose another folder"):
        check_folder(tmp_path, _RUN)


@pytest.mark.parametrize("name", ["video.mp4", "return.png", "report.html"])
def test_a_file_that_a_run_would_replace_is_refused_if_no_run_wrote_it(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text("a film of `limberjack record`")
    with pytest.raises(ValueError, match=rf"holds {name} but no result\.json, so it is not the"):
        check_folder(tmp_path, _RUN)


@pytest.mark.skipif(os.name == "nt", reason="Windows links need a privilege")
@pytest.mark.parametrize("name", ["result.json", "video.mp4", "return.png", "report.html"])
def test_a_link_to_nothing_is_not_replaced(name: str, tmp_path: Path) -> None:
    (tmp_path / name).symlink_to(tmp_path / "nothing")
    with pytest.raises((ValueError, FileNotFoundError), match=name):
        check_folder(tmp_path, _RUN)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_result_that_is_a_pipe_or_a_folder_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    os.mkfifo(path)
    with pytest.raises(ValueError, match=r"result\.json is a pipe; expected a regular file"):
        check_folder(tmp_path, _RUN)
    path.unlink()
    path.mkdir()
    with pytest.raises(IsADirectoryError, match=r"result\.json"):
        check_folder(tmp_path, _RUN)
