"""Scores of a policy, with confidence intervals and baselines on the same seeds.

    from limberjack.evaluation import evaluate

    evaluation = evaluate("manipulator", "bring_ball", "random", range(100), out="scores")
    print(evaluation.summary())             # mean, its 95 % interval, median, successes
    print(evaluation.strata())              # the same for each kind of start
    print(evaluation.summary("zero"))       # zero actions, on the same seeds

    found = evaluate_set("dmc28", "my_agents:Learned", out="set")      # by the protocol of papers
    print(found.interquartile_mean)         # of the scores on all 28 tasks

Episode k is the first episode of the environment with the k-th seed. Episodes run in batches on all
cores and are saved as they end, so that the same call continues where an earlier one was killed. It
trains nothing, and it compares only policies that played the same seeds. `published` has the scores
of others, and `sets` the tasks that papers report together.
"""

from limberjack.episodes.statistics import Score, Summary
from limberjack.evaluation.experiment import FLOORS, evaluate
from limberjack.evaluation.protocol import SetEvaluation, evaluate_set
from limberjack.evaluation.results import Evaluation

__all__ = [
    "FLOORS",
    "Evaluation",
    "Score",
    "SetEvaluation",
    "Summary",
    "evaluate",
    "evaluate_set",
]
