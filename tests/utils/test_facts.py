"""Facts that identify results."""

import pytest

from limberjack.utils.facts import title_of


@pytest.mark.parametrize(
    ("facts", "title"),
    [
        ({"domain": "humanoid", "task": "walk"}, "humanoid walk"),
        ({"environment": "my_package:make", "environment_sha256": "0"}, "my_package:make"),
    ],
)
def test_a_title_is_the_task_or_the_function(facts: dict[str, str], title: str) -> None:
    assert title_of(facts) == title
