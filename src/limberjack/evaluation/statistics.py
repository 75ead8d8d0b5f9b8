"""Statistics of runs on a set of tasks, as papers report them.

    scores = returns / 1000                             # (runs, tasks)
    interquartile_mean(scores)                          # mean of the middle half of all scores
    stratified_interval(scores)                         # its 95 % interval
    percentiles(scores)                                 # of the runs' mean scores

A run is one training of an agent, and its score on a task is the mean over its episodes. The
definitions are those of rliable (https://github.com/google-research/rliable, commit 3ccd9f4):
`aggregate_iqm`, and `get_interval_estimates` with its defaults. Statistics of the episodes of one
policy on one task are in `limberjack.episodes.statistics`.
"""

import contextlib

import numpy as np

from limberjack.episodes.statistics import bootstrapped

__all__ = ["PERCENTILES", "RESAMPLES", "interquartile_mean", "percentiles", "stratified_interval"]

RESAMPLES = 50_000  # rliable's default
PERCENTILES = (5, 25, 50, 75, 95)

_CUT = 0.25  # share of the scores that is left out at each end


def interquartile_mean(scores: np.ndarray) -> np.ndarray:
    """The mean of the scores without the lowest and the highest quarter, over the last two axes.

    Of n scores the floor(n / 4) lowest and as many of the highest are left out.

    Args:
      scores: (..., runs, tasks).

    Returns:
      (...).

    Raises:
      ValueError: a score is not finite, or there are none.
    """
    checked = _finite(scores)
    flat = np.sort(checked.reshape(*checked.shape[:-2], -1), axis=-1)
    cut = int(_CUT * flat.shape[-1])
    return flat[..., cut : flat.shape[-1] - cut].mean(axis=-1)


def stratified_interval(
    scores: np.ndarray, *, resamples: int = RESAMPLES
) -> tuple[float, float] | None:
    """The 95 % interval of the interquartile mean over runs, by the stratified bootstrap.

    Each task is a stratum: a resample has, for each task, as many of that task's scores as there
    are runs, drawn with replacement. The bounds are the 2.5 % and the 97.5 % quantile of the
    statistic. The tasks stay the same: the interval says what other runs on them would give.

    Args:
      scores: (runs, tasks).
      resamples: number of resamples, at least 1.

    Returns:
      The bounds; None for fewer than two runs, which have no spread.

    Raises:
      ValueError: the scores have another shape, are not finite, or there are none.
    """
    scores = _checked(scores)
    runs, tasks = scores.shape
    if runs < 2:
        return None

    def of_resamples(stream: np.random.RandomState, count: int) -> np.ndarray:
        drawn = stream.randint(runs, size=(count, runs, tasks))
        return interquartile_mean(scores[drawn, np.arange(tasks)])

    return bootstrapped(of_resamples, scores.size, resamples)


def percentiles(scores: np.ndarray) -> dict[int, float]:
    """The 5th, 25th, 50th, 75th and 95th percentile of the runs' mean scores over all tasks.

    Args:
      scores: (runs, tasks).

    Raises:
      ValueError: the scores have another shape, are not finite, or there are none.
    """
    of_runs = _checked(scores).mean(axis=-1)
    return dict(zip(PERCENTILES, np.percentile(of_runs, PERCENTILES).tolist(), strict=True))


def _checked(scores: np.ndarray) -> np.ndarray:
    """The scores, if they are a matrix of finite numbers."""
    scores = _numbers(scores)
    if scores.ndim != 2:
        raise ValueError(f"scores have shape {scores.shape}; expected (runs, tasks)")
    return _finite(scores)


def _finite(scores: np.ndarray) -> np.ndarray:
    """The scores, (..., runs, tasks), if all are finite; a sort would hide others at its end."""
    scores = _numbers(scores)
    if scores.size == 0 or scores.ndim < 2:
        raise ValueError(f"scores have shape {scores.shape}; expected at least one run and task")
    if not np.isfinite(scores).all():
        index = tuple(np.argwhere(~np.isfinite(scores))[0].tolist())
        *_, run, task = 0, *index
        raise ValueError(
            f"the score of run {run} on task {task} is {scores[index]}; leave out tasks that a run "
            "lacks"
        )
    return scores


def _numbers(scores: np.ndarray) -> np.ndarray:
    """The scores as an array; raises ValueError for lists of other things or of unequal lengths."""
    with contextlib.suppress(ValueError):  # of unequal lengths
        found = np.asarray(scores)
        if found.dtype.kind in "biuf":
            return found
    raise ValueError(
        "scores are not numbers in lists of equal length; expected (runs, tasks): leave out tasks "
        "that a run lacks"
    )
