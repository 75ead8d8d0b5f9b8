"""The table has a row for each domain, some tasks have their own, and files replace a row."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.training import TABLE, Settings, read_settings, settings, settings_for


def test_each_domain_of_the_suite_has_a_row_and_only_tasks_of_it_have_more() -> None:
    tasks = {f"{domain}:{task}" for domain, task in suite.ALL_TASKS}
    assert suite.TASKS_BY_DOMAIN.keys() <= TABLE.keys() <= suite.TASKS_BY_DOMAIN.keys() | tasks
    for name, row in TABLE.items():
        assert settings_for(*name.split(":")) is row


def test_a_task_has_the_row_of_its_domain_but_for_what_its_own_row_names() -> None:
    table = tomllib.loads(Path(settings.__file__).with_name("table.toml").read_text("utf-8"))
    of_tasks = [name.split(":") for name in table if ":" in name]
    assert of_tasks
    for domain, task in of_tasks:
        own = Settings.of_toml({**table[domain], **table[f"{domain}:{task}"]})
        assert settings_for(domain, task) == own != settings_for(domain)
    assert settings_for("walker", "stand") is settings_for("walker", "walk") is TABLE["walker"]


def test_tasks_without_a_row_have_the_defaults() -> None:
    assert settings_for("swing") == Settings()


def test_noise_is_a_number_from_0_to_1_with_both() -> None:
    assert [Settings(noise=one).noise for one in (0, 1, 1.0)] == [0, 1, 1.0]


def test_lists_and_numbers_of_numpy_are_taken_as_those_of_python() -> None:
    given: dict[str, Any] = {"actor": [64, 32], "steps": np.int64(100), "noise": np.float32(0.5)}
    taken = Settings(**given)
    assert (taken.actor, taken.steps, taken.noise) == ((64, 32), 100, 0.5)
    assert type(taken.steps) is int


@pytest.mark.parametrize(("num_envs", "updates"), [(8, 0.3), (8, 0.05), (1, 0.5), (1, 2.5)])
def test_updates_that_are_no_whole_number_for_all_rows_are_refused(
    num_envs: int, updates: float
) -> None:
    with pytest.raises(ValueError, match="expected a whole number in all, as with updates = "):
        Settings(num_envs=num_envs, updates=updates)
    assert Settings(num_envs=3, updates=0.667).updates == 0.667


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
        ("steps = true", "steps is True; expected a whole number of at least 1"),
        ("actor = 64", "actor is 64; expected widths of layers"),
        ("actor = [0]", r"actor is \(0,\); expected widths of layers"),
        ("time_limit = 0", "time_limit is 0; expected seconds"),
        ("updates = 1e308", r"updates is 1e\+308, inf in all for the 8 rows; expected a whole"),
        ("action_repeat = 1001", "action_repeat is 1001; expected a whole number up to 1000"),
        ("action_bound = 1e9", r"action_bound is 1000000000.0; expected a positive number below"),
        ("action_bound = 0.0", r"action_bound is 0.0; expected a positive number below 1e\+09"),
        ("[walker]\nsteps = 3", r"mine.toml: \[walker\] begins a table; expected its lines"),
        ("steps = ", "mine.toml: "),
        ("\udcff", "mine.toml: "),
    ],
)
def test_a_file_with_a_mistake_is_refused_by_name(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(ValueError, match=message):
        read_settings(path)
