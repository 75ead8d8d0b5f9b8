"""`PlanCosts`: the costs of plans that were rolled out, and the mistakes that a cost can have.

    plan_costs = PlanCosts(cost, now)
    plan_costs.of(rollouts, diverged)       # (samples,), infinite where a plan cannot be used
    plan_costs.terms_of(rollouts, best)     # the weighted terms of one plan, by name

A plan's cost is the mean over the control steps at which it is computed, and the cost's `terminal`
at the horizon. A term that is no number or has a wrong shape, an error that only a batch has, and a
cost that no plan gives a finite value are raised with the name of the term and the change to make.
"""

import contextlib
from collections.abc import Iterator

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.planner.cost import Cost, FunctionCost, name_of
from limberjack.planner.rollouts import Rollouts
from limberjack.rl.batch_errors import NotVectorised, raised_in_a_batch, wrong_shape
from limberjack.utils.arrays import rows_of_a_batch

__all__ = ["PlanCosts"]

_TERMINAL = "terminal"  # its name among the terms of a plan


class PlanCosts:
    """The costs of plans; see the module's docstring."""

    def __init__(self, cost: Cost, now: Physics) -> None:
        """Takes the cost, and a single simulation on which errors are compared."""
        self._cost, self._now = cost, now
        self._is_checked = False  # whether the shapes of the terms have been compared

    def of(self, rollouts: Rollouts, diverged: np.ndarray) -> np.ndarray | None:
        """The cost of each plan, (samples,); infinite where it diverges or the cost is no number.

        None if the cost has read fields that were not recorded, but are from now on.

        Raises:
          ValueError: the cost returns something else than one number for each state, or no number
            for any plan.
        """
        steps = self._values(rollouts.seen, "step_cost")
        assert steps is not None
        cost = steps.reshape(-1, len(diverged)).mean(axis=0)
        last = self._values(rollouts.at_horizon, _TERMINAL)
        if not rollouts.history.is_complete:
            return None
        if last is not None:
            cost = cost + last
        unusable = diverged | ~np.isfinite(cost)
        if unusable.all() and not diverged.all():
            raise self._without_a_finite_cost(rollouts, diverged, last)
        return np.where(unusable, np.inf, cost)

    def terms_of(self, rollouts: Rollouts, sample: int) -> dict[str, float]:
        """The weighted terms of a plan, each the mean over its steps, and what is terminal."""
        terms = self._by_plan(rollouts, rollouts.simulation.num_envs or 0)
        found = {name: float(values[:, sample].mean()) for name, values in terms.items()}
        last = self._values(rollouts.at_horizon, _TERMINAL)
        return found if last is None else {**found, _TERMINAL: float(last[sample])}

    def _by_plan(self, rollouts: Rollouts, samples: int) -> dict[str, np.ndarray]:
        """The weighted terms of all plans at all steps, (steps, samples) each."""
        states = rollouts.history.num_envs or 0
        with rows_of_a_batch(states):
            terms = self._cost.weighted_terms(rollouts.seen)
        return {n: np.broadcast_to(t, states).reshape(-1, samples) for n, t in terms.items()}

    def _values(self, seen: Physics, method: str) -> np.ndarray | None:
        """The value of a method of the cost for each state that is seen, (states,)."""
        states = seen.num_envs or 0
        if not self._is_checked:
            self._check_terms(seen, states)
        with rows_of_a_batch(states), self._explained(method, states):
            returned = getattr(self._cost, method)(seen)
        if returned is None and method == _TERMINAL:
            return None
        cost = np.asarray(returned)
        if cost.shape != (states,) or cost.dtype.kind not in "biuf":
            raise ValueError(
                f"{method} of {name_of(self._cost)} returned shape {cost.shape} and dtype "
                f"{cost.dtype}; expected numbers of shape {(states,)}, one cost for each state"
            )
        return cost

    def _check_terms(self, seen: Physics, states: int) -> None:
        """Raises ValueError unless each term has one number for each state.

        A term of a class may be one number for all states, as in a stage that lacks it. Of a
        function it is a mistake: a norm or a sum over all states.
        """
        self._is_checked = True
        if type(self._cost).terms is Cost.terms:
            return
        with rows_of_a_batch(states), self._explained("terms", states):
            terms = self._cost.terms(seen)
        shapes = [(states,)] if isinstance(self._cost, FunctionCost) else [(states,), ()]
        for name, term in terms.items():
            found = np.asarray(term)
            what = f"term {name!r} of cost {name_of(self._cost)}"
            if found.dtype.kind not in "biuf":
                raise ValueError(f"{what} is {_described(term, found.dtype)}; expected numbers")
            if found.shape not in shapes:
                raise wrong_shape(what, found.shape, (states,))

    @contextlib.contextmanager
    def _explained(self, method: str, states: int) -> Iterator[None]:
        """Explains an error that the cost raises in a batch, and not in a single simulation."""
        try:
            yield
        except NotVectorised:
            raise
        except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError) as error:
            getattr(self._cost, method)(self._now)  # raises it too if rows have no part in it
            what = f"cost {name_of(self._cost)}"
            raise raised_in_a_batch(what, error, states) from error

    def _without_a_finite_cost(
        self, rollouts: Rollouts, diverged: np.ndarray, last: np.ndarray | None
    ) -> ValueError:
        """The error for a cost that is infinite or NaN for each plan, with the terms that are."""
        terms = self._by_plan(rollouts, len(diverged))
        if last is not None:
            terms[_TERMINAL] = last[None]
        found = {name: values[:, ~diverged] for name, values in terms.items()}
        wrong = {name: x[~np.isfinite(x)] for name, x in found.items()}
        named = {repr(name): x[0] for name, x in wrong.items() if x.size}
        value = next(iter(named.values()), "not finite")
        return ValueError(
            f"no plan has a finite cost: {', '.join(named) or 'step_cost'} of "
            f"{name_of(self._cost)} is {value}; expected finite numbers: look for a division by 0 "
            "or a root of a negative number"
        )


def _described(term: object, dtype: np.dtype) -> str:
    """A term that is no number, in words."""
    if callable(term):
        return f"a function that is not called: write {getattr(term, '__name__', 'it')}()"
    return "None: it must be returned" if term is None else f"of dtype {dtype}"
