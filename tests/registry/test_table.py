"""The generated table of tasks is what the suite's modules define."""

import importlib

from limberjack import registry, suite
from tests.suite import task_table


def test_the_table_matches_the_modules() -> None:
    written = task_table.TABLE.read_text(encoding="utf-8")
    assert written == task_table.text(), "run python tests/suite/task_table.py"
    assert list(registry.TASKS) == task_table.rows()


def test_the_constants_follow_from_the_modules_as_in_dm_control() -> None:
    modules = {
        name: importlib.import_module(f"limberjack.suite.{name}") for name in task_table.domains()
    }
    for tag, constant in (
        ("benchmarking", suite.BENCHMARKING),
        ("easy", suite.EASY),
        ("hard", suite.HARD),
        ("no_reward_visualization", suite.NO_REWARD_VIZ),
    ):
        tagged = [(name, task) for name, m in modules.items() for task in m.SUITE.tagged(tag)]
        assert sorted(constant) == sorted(tagged)
    assert tuple((n, task) for n, m in modules.items() for task in m.SUITE) == suite.ALL_TASKS
    assert suite._get_tasks(None) == suite.ALL_TASKS
