"""Published scores: every task, every source, and comparisons at equal steps only."""

import re

import pytest

from limberjack import suite
from limberjack.evaluation import published

_SCORES = published.scores()


def test_every_task_has_a_score_or_is_named_as_one_without() -> None:
    have = {(score.domain, score.task) for score in _SCORES}
    assert not have & set(published.none_found())
    assert have | set(published.none_found()) == set(suite.ALL_TASKS)


def test_a_source_has_one_score_for_a_task_and_number_of_steps() -> None:
    keys = [(score.domain, score.task, score.source.name, score.steps) for score in _SCORES]
    assert len(set(keys)) == len(keys)


def test_scores_are_in_the_order_of_the_suite() -> None:
    tasks = [(score.domain, score.task) for score in _SCORES]
    assert tasks == sorted(tasks, key=suite.ALL_TASKS.index)


def test_a_task_that_does_not_exist_is_refused_without_a_domain_too() -> None:
    assert {score.task for score in published.scores(task="walk")} == {"walk"}
    for domain in (None, "walker"):
        with pytest.raises(ValueError, match=r"no .*'.* Did you mean"):
            published.scores(domain, "wlak")


def test_every_score_is_possible() -> None:
    widest = 1000 / 2**0.5  # standard deviation of two runs, one of which reached everything
    for score in _SCORES:
        assert 0 <= score.mean <= 1000, score
        assert score.spread is None or 0 <= score.spread <= widest, score
        assert score.seeds is None or score.seeds >= 1, score
        assert score.steps is None or 900_000 <= score.steps <= 100_000_000, score


@pytest.mark.parametrize("source", published.sources().values(), ids=lambda source: source.name)
def test_a_source_can_be_read_again_or_says_that_it_was_not(source: published.Source) -> None:
    assert re.match(r"https://(github\.com/[\w.-]+/[\w.-]+|arxiv\.org/abs/[\d.]+)$", source.address)
    assert all((source.algorithm, source.file, source.licence, source.mean, source.spread))
    if source.revision is None:
        assert source.second_hand
    else:
        assert re.fullmatch(r"[0-9a-f]{40}", source.revision)
    assert any(score.source == source for score in _SCORES)


def test_scores_of_a_domain_and_of_a_task_are_parts_of_all() -> None:
    humanoid = published.scores("humanoid")
    walk = published.scores("humanoid", "walk")
    assert {score.task for score in humanoid} == {"stand", "walk", "run", "run_pure_state"}
    assert {score.algorithm for score in walk} >= {"FlashSAC", "TD-MPC2", "BRO", "MR.Q"}
    assert set(walk) < set(humanoid) < set(_SCORES)
    assert published.scores("lqr", "lqr_2_1") == ()


def test_the_best_is_that_after_the_same_number_of_steps() -> None:
    one, four = (published.best("acrobot", "swingup", steps) for steps in (1_000_000, 4_000_000))
    assert one is not None
    assert four is not None
    assert (one.algorithm, one.mean) == ("MR.Q", 567.0)
    assert (four.algorithm, four.mean) == ("TD-MPC2", 662.9)
    assert published.best("acrobot", "swingup", 2_000_000) is None


def test_a_run_that_ends_an_evaluation_early_has_the_same_number_of_steps() -> None:
    found = published.best("dog", "run", 14_000_000)
    assert found is not None
    assert found.steps == 13_900_000


def test_scores_that_were_learned_from_a_dataset_are_compared_among_themselves() -> None:
    found = published.best("manipulator", "insert_peg", None)
    assert found is not None
    assert found.steps is None
    assert found.mean > max(
        score.mean for score in published.scores("manipulator", "insert_peg") if score.steps
    )


def test_agent_steps_are_control_steps_by_the_action_repeat() -> None:
    by_source = {score.source.name: score for score in published.scores("humanoid", "walk")}
    assert by_source["simbav2"].agent_steps == 500_000
    assert by_source["flashsac"].agent_steps == 1_000_000
    assert by_source["xqc"].agent_steps is None  # its action repeat was not found


def test_an_unknown_name_is_refused_with_a_close_one() -> None:
    with pytest.raises(ValueError, match=r"no 'human' .*Did you mean 'humanoid'\?"):
        published.scores("human")
    with pytest.raises(ValueError, match="no 'humanoid hop' among the suite's published scores"):
        published.best("humanoid", "hop", 1_000_000)
