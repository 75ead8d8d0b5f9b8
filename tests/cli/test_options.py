"""Arguments that several commands have: the task's name."""

from pathlib import Path

import pytest

from limberjack.cli.options import named_task, seeds_from, shard_named
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


def test_the_seeds_of_episodes_follow_each_other_up_to_the_last_one() -> None:
    assert list(seeds_from(4, 3)) == [4, 5, 6]
    assert seeds_from(2**32 - 1, 1)[-1] == 2**32 - 1
    for first, episodes in ((2**32 - 1, 2), (0, 10**12)):
        with pytest.raises(ValueError, match=r"the last episode's seed is .* expected below"):
            seeds_from(first, episodes)


def test_a_shard_is_named_by_its_number_and_that_of_all() -> None:
    assert shard_named("3/8", "out") == (3, 8)
    assert shard_named(None, None) is None


@pytest.mark.parametrize("shard", ["0/8", "9/8", "3", "3/", "a/b", "3/8/9", "-1/8"])
def test_a_shard_that_does_not_exist_is_refused(shard: str) -> None:
    with pytest.raises(ValueError, match="expected K/N with K from 1 to N, such as 3/8"):
        shard_named(shard, "out")


def test_a_shard_needs_a_folder() -> None:
    with pytest.raises(ValueError, match="--shard 3/8 needs --out DIR"):
        shard_named("3/8", None)


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
