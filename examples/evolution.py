"""Evolution: a linear policy learns lqr from returns alone, with NumPy, on a few hundred rows.

    pip install .
    python examples/evolution.py --steps 40000000 --seed 0 --out evolved

Of each pair of policies one has some noise added to the weights, and the other has it taken away.
All play the same episodes, and the weights move along the noise of those that did better: Salimans
et al., 2017, with ranks in the place of returns, and Mania et al., 2018, for linear policies. The
springs of lqr are drawn for each seed, here for each episode, and are not observed. A value
function takes what is observed for all that matters; a return does not.

It writes the policy, which `limberjack run lqr lqr_6_2 --time-limit 30 --policy
mlp:evolved/policy.safetensors` plays, and curve.csv with the columns of `limberjack train`.
"""

import argparse
import csv
import time
from collections.abc import Sequence
from pathlib import Path

import dm_env
import numpy as np

from limberjack import suite
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import mlp
from limberjack.policies.networks import layout_of
from limberjack.rl.batch import BatchEnvironment

_DOMAIN = "lqr"
_REPEAT = 2  # control steps per action
_BOUND = 8.0  # of an action; those of lqr have none
_SECONDS, _STEPS = 30.0, 1000  # of an episode, which lqr does not limit
_EPISODES = 16  # that each policy plays: springs and starts
_NOISE = 0.05  # standard deviation of what is added to a weight; the best ones are up to 4
_RATE = 0.05  # of Adam; it falls to 0 at the end
_DECAYS = 0.9, 0.99  # of Adam's means, over ten generations and a hundred
_TINY = 1e-8
_TRAINED = 1_000_000  # first seed of training
_EVALUATED = range(2_100_000_000, 2_100_000_010)  # those of the curve, as in `limberjack train`
_EVALUATIONS = 20  # after the one at the beginning


class _Rows:
    """A batch whose rows play linear policies for an episode each."""

    def __init__(self, task: str, count: int) -> None:
        self._batch: BatchEnvironment = suite.load_batch(
            _DOMAIN, task, count, task_kwargs={"time_limit": _SECONDS}, action_repeat=_REPEAT
        )
        self._layout = tuple(
            (name, spec.shape[1:]) for name, spec in self._batch.observation_spec().items()
        )
        (self.num_actions,) = self._batch.single_action_spec().shape
        self.num_observations = sum(int(np.prod(shape)) for _, shape in self._layout)

    def returns(self, weights: np.ndarray, seeds: Sequence[int]) -> np.ndarray:
        """The returns of policies, (policies, episodes), each with an episode of each seed.

        weights: (policies, actions, observations), as many as the rows divided by the seeds.
        """
        of_rows = np.repeat(weights, len(seeds), axis=0)
        time_step = self._batch.reset(seeds=[*seeds] * len(weights))
        total, runs = np.zeros(len(of_rows)), np.ones(len(of_rows), bool)
        while runs.any():
            seen = mlp.flattened(self._layout, time_step.observation)
            actions = np.einsum("rao,ro->ra", of_rows, seen)
            time_step = self._batch.step(np.clip(actions, -_BOUND, _BOUND))
            total += np.where(runs, time_step.reward, 0.0)
            runs &= time_step.step_type != dm_env.StepType.LAST
        return total.reshape(len(weights), len(seeds))


class _Search:
    """The weights, and how they move."""

    def __init__(self, shape: tuple[int, int], pairs: int, seed: int) -> None:
        self.weights = np.zeros(shape)
        self._random = np.random.RandomState(seed)
        self._noise = np.zeros((pairs, *shape))
        self._mean, self._square, self._count = np.zeros(shape), np.zeros(shape), 0

    def policies(self) -> np.ndarray:
        """The weights of the policies of the next generation, (2 * pairs, ...)."""
        self._noise = self._random.standard_normal(self._noise.shape)
        scaled = _NOISE * self._noise
        return np.concatenate([self.weights + scaled, self.weights - scaled])

    def move(self, returns: np.ndarray, rate: float) -> None:
        """Moves the weights, given the mean return of each policy, (2 * pairs,)."""
        pairs = len(self._noise)
        ranks = np.argsort(np.argsort(returns)) / (2 * pairs - 1) - 0.5
        slope = np.tensordot(ranks[:pairs] - ranks[pairs:], self._noise, 1) / pairs
        of_mean, of_square = _DECAYS
        self._count += 1
        self._mean = of_mean * self._mean + (1 - of_mean) * slope
        self._square = of_square * self._square + (1 - of_square) * slope**2
        mean = self._mean / (1 - of_mean**self._count)
        square = self._square / (1 - of_square**self._count)
        self.weights = self.weights + rate * mean / (np.sqrt(square) + _TINY)


def _learn(
    task: str, least_steps: int, pairs: int, seed: int
) -> tuple[np.ndarray, list[list[float]]]:
    """The weights, (actions, observations), and the lines of the curve."""
    rows, tested = _Rows(task, 2 * pairs * _EPISODES), _Rows(task, len(_EVALUATED))
    search = _Search((rows.num_actions, rows.num_observations), pairs, seed)
    curve: list[list[float]] = []
    steps, starts = 0, np.random.RandomState(seed)
    began = time.process_time()
    while True:
        if steps * _EVALUATIONS >= least_steps * len(curve):
            (returns,) = tested.returns(search.weights[None], _EVALUATED)
            seconds, mean = time.process_time() - began, returns.mean()
            curve.append([steps, steps // _REPEAT, round(seconds, 2), mean, *returns])
            print(f"{steps:>12,} control steps, {seconds:7.1f} s, return {mean:.2f}", flush=True)
        if steps >= least_steps:
            return search.weights, curve
        first = _TRAINED + int(starts.randint(1_000_000_000))
        returns = rows.returns(search.policies(), range(first, first + _EPISODES))
        search.move(returns.mean(axis=1), _RATE * (1 - steps / least_steps))
        steps += _STEPS * returns.size


def _card(task: str, steps: int, seed: int, command: str) -> mlp.Card:
    """The card of the policy."""
    with suite.load(_DOMAIN, task, {"random": 0}) as environment:
        layout = layout_of(environment)
        (count,) = environment.action_spec().shape
        model = fingerprint(environment.physics.model.ptr)
    return mlp.Card(
        layout=layout,
        low=(-_BOUND,) * count,
        high=(_BOUND,) * count,
        end="none",
        action_repeat=_REPEAT,
        domain=_DOMAIN,
        task=task,
        algorithm="evolution",
        command=command,
        seeds=(seed,),
        steps=steps,
        versions=versions(),
        fingerprint=model,
    )


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", default="lqr_6_2", help="of lqr")
    parser.add_argument("--steps", type=int, default=40_000_000, help="control steps of all rows")
    parser.add_argument("--envs", type=int, default=384, help="rows of the batch")
    parser.add_argument("--seed", type=int, default=0, help="of the noise and the episodes")
    parser.add_argument("--out", type=Path, help="folder for the policy and its curve")
    given = parser.parse_args()

    pairs = max(1, given.envs // (2 * _EPISODES))
    weights, curve = _learn(given.task, given.steps, pairs, given.seed)
    if given.out is not None:
        given.out.mkdir(parents=True, exist_ok=True)
        options = [f"--{name} {getattr(given, name)}" for name in ("task", "steps", "envs", "seed")]
        command = " ".join(["python examples/evolution.py", *options])
        card = _card(given.task, int(curve[-1][0]), given.seed, command)
        mlp.save(given.out / "policy.safetensors", [(weights, np.zeros(len(weights)))], card)
        with (given.out / "curve.csv").open("w", newline="", encoding="utf-8") as file:
            names = [f"return_{number}" for number in range(1, len(_EVALUATED) + 1)]
            head = ["control_steps", "agent_steps", "processor_seconds", "mean", *names]
            csv.writer(file).writerows([head, *curve])


if __name__ == "__main__":
    main()
