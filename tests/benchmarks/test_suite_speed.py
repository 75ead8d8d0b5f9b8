"""The classes of tasks in the benchmark of the whole suite; `test_quick_runs` runs it."""

import json

import sources

from limberjack import suite


def test_every_task_has_a_class() -> None:
    classes = json.loads((sources.RESULTS / "classes.json").read_text(encoding="utf-8"))
    assert list(classes) == [f"{domain}:{task}" for domain, task in suite.ALL_TASKS]
    assert all(microseconds > 0 for microseconds in classes.values())
