"""`Evaluation`, and the files that show it."""

import json
from typing import Any, cast

from limberjack.episodes.manifest import in_lines
from limberjack.evaluation import Evaluation, Score
from limberjack.utils.facts import Facts

_FACTS = cast(Facts, {"domain": "humanoid", "task": "stand", "versions": {}})


def _evaluation(processor: str | None) -> Evaluation:
    scores = [Score(seed, 1.0, 10, 0.1, processor=processor) for seed in range(3)]
    return Evaluation(_FACTS, {"mine": scores, "zero": scores})


def _as_json(processor: str | None) -> Any:
    return _evaluation(processor).as_json()


def test_processors_are_listed_only_where_they_were_recorded() -> None:
    plain, named = (_as_json(name) for name in (None, "one"))
    assert "processor" not in plain["episodes"][0]
    assert "processors" not in plain["floors"]["zero"]
    assert [episode["processor"] for episode in named["episodes"]] == ["one"] * 3
    assert named["floors"]["zero"]["processors"] == ["one"] * 3


def test_an_episode_says_that_it_diverged() -> None:
    scores = [Score(seed, 1.0, 10, 0.0, diverged=seed == 1) for seed in range(3)]
    episodes = Evaluation(_FACTS, {"zero": scores}).as_json()["episodes"]
    assert [entry.get("diverged") for entry in episodes] == [None, True, None]


def test_result_json_has_one_line_for_each_episode() -> None:
    content = _evaluation("one").as_json()
    text = in_lines(content)
    assert json.loads(text) == json.loads(json.dumps(content))
    assert sum('"seed"' in line for line in text.splitlines()) == 3
