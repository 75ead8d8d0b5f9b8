"""Arguments that several commands have: the task's name."""

from pathlib import Path

import pytest

from limberjack.cli.options import named_task
from tests.cli.conftest import invoke


@pytest.mark.parametrize("arguments", [("humanoid", "walk"), ("humanoid/walk", None)])
def test_a_task_is_named_by_two_words_or_one(arguments: tuple[str, str | None]) -> None:
    assert named_task(*arguments) == ("humanoid", "walk")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("humanoid", None),
            "got humanoid without a task; choose one of: run, run_pure_state, sta",
        ),
        (
            ("humanod", None),
            "got humanod without a task; expected DOMAIN TASK or DOMAIN/TASK. Did ",
        ),
        (("humanoid/walk", "walk"), "got humanoid/walk and walk; expected DOMAIN TASK or DOMAIN/T"),
    ],
)
def test_a_task_named_by_none_or_both_is_refused(
    arguments: tuple[str, str | None], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        named_task(*arguments)


@pytest.mark.parametrize("name", ["humanoid/wlak", "humanoid/", "/walk"])
@pytest.mark.parametrize(
    "command",
    [
        ["run"],
        ["solve"],
        ["view"],
        ["bench", "--num-envs", "2"],
        ["evaluate", "--seeds", "0:2"],
        ["record", "--out", "film.mp4"],
    ],
)
def test_every_command_that_takes_a_task_takes_one_word(
    command: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*command, name)
    assert result.exit_code == 2
    expected = "Choose one of: run, run_pure_state, stand, walk." if "humanoid" in name else "''"
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1
    assert invoke(*command, "humanoid").stderr.startswith("limberjack: got humanoid without a task")
    assert list(tmp_path.iterdir()) == []
