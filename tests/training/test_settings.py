"""The table has a row for each domain, and files replace a row."""

import dataclasses
from pathlib import Path

import pytest

from limberjack import suite
from limberjack.training import TABLE, Settings, read_settings, settings_for


def test_each_domain_of_the_suite_has_a_row_and_nothing_else_does() -> None:
    assert TABLE.keys() == suite.TASKS_BY_DOMAIN.keys()
    for domain, row in TABLE.items():
        assert settings_for(domain) is row


def test_tasks_without_a_row_have_the_defaults() -> None:
    assert settings_for("swing") == Settings()


def test_a_file_replaces_numbers_and_leaves_defaults(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("learning_rate = 3e-4\nactor = [64]\n")
    assert read_settings(path) == dataclasses.replace(Settings(), learning_rate=3e-4, actor=(64,))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("learning_rat = 1e-3", "no setting 'learning_rat'.*learning_rate"),
        ("learning_rate = -1.0", "learning_rate is -1.0; expected a positive number"),
        ("learning_rate = nan", "learning_rate is nan; expected a positive number"),
        ("learning_rate = true", "learning_rate is True; expected a positive number"),
        ("discount = 1.0", "discount is 1.0; expected a number between 0 and 1"),
        ("num_envs = 1001", "num_envs is 1001; expected a whole number up to 1000"),
        ("learning_rate = inf", "learning_rate is inf; expected a positive number"),
        ("noise = 1.5", "noise is 1.5; expected a number from 0 to 1"),
        ("reward_offset = 'x'", "reward_offset is 'x'; expected a number"),
        ("steps = 1.5", "steps is 1.5; expected a whole number of at least 1"),
        ("actor = 64", "actor is 64; expected widths of layers"),
        ("actor = [0]", r"actor is \(0,\); expected widths of layers"),
        ("time_limit = 0", "time_limit is 0; expected seconds"),
        ("steps = ", "mine.toml: "),
        ("\udcff", "mine.toml: "),
    ],
)
def test_a_file_with_a_mistake_is_refused_by_name(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(ValueError, match=message):
        read_settings(path)
