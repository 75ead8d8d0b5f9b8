"""How good a policy is, with all that is needed to believe it.

    from limberjack.evaluation import evaluate

    evaluation = evaluate("manipulator", "bring_ball", "random", range(100), out="scores")
    print(evaluation.summary())             # mean, its 95 % interval, median, successes
    print(evaluation.strata())              # the same for each kind of start
    print(evaluation.summary("zero"))       # doing nothing, on the same seeds

Episode k is the first one of the environment with the k-th seed. Episodes run in batches on all
cores and are kept as they end: the same call goes on where an earlier one was killed. It trains
nothing, and it compares nothing that was not run on the same seeds.
"""

from limberjack.evaluation.experiment import FLOORS, Evaluation, evaluate
from limberjack.evaluation.statistics import Score, Summary

__all__ = ["FLOORS", "Evaluation", "Score", "Summary", "evaluate"]
