"""`Planner`: sampling-based model-predictive control (MPC).

    planner = Planner(env, seed=0)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(planner.act())

A plan is a spline of targets for the actuators (`spline.py`, `control_law.py`). `Planner.act` does
what a planner of MuJoCo MPC does in three steps:

1. `_set_state`: the environment's full state is read, and the cost updates its stage.
2. `_optimise`: the current plan, random variations of it and the cost's proposals are rolled out in
   a batch from that state. The new plan is their mean, weighted so that low costs count most
   (MPPI: Williams et al., 2017, "Information theoretic MPC").
3. `_action`: the control law follows the plan, until `Settings.interval` control steps have passed.
   The next planning step starts from that plan, shifted by the elapsed time.

The planner reads the environment's simulator state, not its observations, and never writes to it.
The same seed gives the same actions for any number of threads, unless a time budget is given.
"""

import contextlib
import enum
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from limberjack.mujoco.simulation import model_fields, without_calls
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.cost import AnyPhysics, Cost, CostFunction, FunctionCost, cost_for, name_of
from limberjack.planner.planning_model import enable_sleep, planning_model_of
from limberjack.planner.rollouts import Budget, Rollouts
from limberjack.planner.servos import Servos
from limberjack.planner.settings import Settings
from limberjack.planner.spline import knot_weights, targets_at
from limberjack.rl import control
from limberjack.rl.batch_errors import NotVectorised, raised_in_a_batch, wrong_shape
from limberjack.rl.guards import at_least_one
from limberjack.utils.arrays import rows_of_a_batch
from limberjack.utils.cores import usable_cores

__all__ = ["Explanation", "Planner"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


class Explanation(NamedTuple):
    """The best plan of a planning step."""

    stage: str  # name of the cost's stage; empty if it has none
    terms: dict[str, float]  # the cost's weighted terms, each the mean over the plan's steps


class Planner:
    """Chooses actions for one environment; see the module's docstring."""

    def __init__(
        self,
        env: control.Environment,
        num_threads: int | None = None,
        seed: int = 0,
        cost: Cost | CostFunction | None = None,
        settings: Settings | None = None,
        max_ms: float | None = None,
    ) -> None:
        """Creates a planner, also before the environment's first reset.

        Args:
          env: a `control.Environment`, of the suite or your own.
          num_threads: number of simulation threads; all usable cores by default.
          seed: seed of the samples; each episode draws the same stream.
          cost: the cost to minimise, or a function that returns its terms; by default the one that
            the environment's task names.
          settings: replace the cost's settings.
          max_ms: milliseconds that a planning step should take, for live use: it tries fewer
            samples if there is no time for all. Actions then depend on the clock and are not
            repeatable. A path search, and a planning step with the fewest samples, may take longer.

        Raises:
          ValueError: the task names no cost, or a setting does not fit the environment.
          TypeError: `env` is another kind of object, such as a Gymnasium environment; or `cost` or
            `settings` is not an instance of its class.
        """
        _check_arguments(env, num_threads, cost, settings)
        self._env, self._seed = env, seed
        if cost is not None and not isinstance(cost, Cost):
            cost = FunctionCost(cost)
        self._cost = cost_for(env.task) if cost is None else cost
        self._is_checked = False  # whether the shapes of the cost's terms have been compared
        self._settings = settings = self._cost.settings if settings is None else settings
        self._law = self._follower = ControlLaw(env.physics.model._model, settings)
        self._budget = Budget(max_ms, settings.samples)
        # The current state, with the environment's own motors for costs that simulate themselves.
        self._now = planning_model_of(env.physics, settings)
        rolled_out = planning_model_of(env.physics, settings)
        if settings.servos:
            self._follower = Servos(rolled_out.model.ptr, self._law)
        if settings.sleep:
            enable_sleep(rolled_out.model.ptr)
        self._substeps = control.compute_n_steps(env.control_timestep(), self._now.timestep())
        self._steps = max(1, round(settings.horizon / env.control_timestep()))
        states = -(-self._steps // settings.cost_interval)
        threads = usable_cores() if num_threads is None else num_threads
        self._fields = tuple(model_fields(env.snapshot().physics))
        self._rollouts = {
            size: Rollouts(rolled_out, size, threads, self._fields, states)
            for size in self._budget.sizes
        }
        self.reset()

    @property
    def settings(self) -> Settings:
        """The settings in use."""
        return self._settings

    def reset(self) -> None:
        """Discards the current plan, for a new episode."""
        self._cost.reset()
        self._cost.phase = 0.0
        self._random = np.random.default_rng(self._seed)
        self._plan: np.ndarray | None = None  # (knots, nu)
        self._age = 0  # control steps since the plan was made
        self._proposals = np.zeros((0, 0, 0))  # (n, knots, nu)
        self._stage, self._uses = None, 0  # of the proposals
        self._best: tuple[Rollouts, int] | None = None  # of the last planning step; which sample
        self._time = -np.inf
        self._state = self._last_action = np.zeros(
            0
        )  # the simulator's at that time, and the action

    def act(self) -> np.ndarray:
        """The action for the environment's current state, (nu,), within the bounds.

        A new episode is detected by its time, and planning then starts from scratch. Calling again
        in the same state returns the same action.

        Raises:
          RuntimeError: no episode is running, so there is no state to plan from.
        """
        if not self._env.is_running:
            raise RuntimeError("no episode is running: call env.reset() before planner.act()")
        physics = self._env.physics
        time, state = physics.time(), physics.get_state(_STATE)
        if time <= self._time:
            if np.array_equal(state, self._state):
                return self._last_action.copy()
            self.reset()
        if self._plan is None or self._age >= self._settings.interval:
            self._budget.begin()
            self._plan = self._optimise(self._set_state())
            self._age = 0
        self._last_action = self._action(self._plan)
        self._time, self._state = time, state
        return self._last_action.copy()

    def explain(self) -> Explanation:
        """The stage, and the cost's terms for the best plan of the last planning step.

        A cost that defines `step_cost` alone has the one term 'cost'.

        Raises:
          RuntimeError: nothing has been planned yet in this episode.
        """
        if self._best is None:
            raise RuntimeError("nothing has been planned: call planner.act() before explain()")
        rollouts, best = self._best
        states, samples = rollouts.history.num_envs or 0, rollouts.simulation.num_envs
        with rows_of_a_batch(states):
            terms = self._cost.weighted_terms(rollouts.seen)
        plan = slice(best, None, samples)
        means = {n: float(np.broadcast_to(t, states)[plan].mean()) for n, t in terms.items()}
        return Explanation(_name_of(self._cost.stage()), means)

    def _set_state(self) -> dict[str, np.ndarray]:
        """Updates the cost in the environment's state; returns that state, to be loaded."""
        # The call that led to the state has other time steps here.
        saved = without_calls(self._env.physics.simulation.save(None, self._fields))
        self._now.simulation.load(saved)
        self._cost.update(self._now)
        return saved

    def _optimise(self, saved: dict[str, np.ndarray]) -> np.ndarray:
        """The plan from a state on, (knots, nu)."""
        samples = self._samples(self._shifted())
        rollouts = self._rollouts[len(samples)]
        costs = self._costs(rollouts, saved, samples)
        self._budget.spent(len(samples))
        self._best = rollouts, int(np.argmin(costs))
        return _weighted_mean(samples, costs, self._settings.temperature)

    def _action(self, plan: np.ndarray) -> np.ndarray:
        """The control that follows the plan from the environment's state, (nu,)."""
        targets = targets_at(plan, self._cost.phase + self._passed())
        self._age += 1
        self._cost.followed(targets)
        physics = self._env.physics
        return self._law.controls(targets, physics.position(), physics.velocity())

    def _passed(self) -> float:
        """Knots since the current plan was made."""
        return self._age * self._env.control_timestep() / self._settings.spacing

    def _shifted(self) -> np.ndarray:
        """The current plan shifted to the current time, (knots, nu)."""
        knots = np.arange(self._settings.knots)
        plan, passed = self._plan, self._passed()
        if plan is None:
            return np.repeat(self._law.held(self._now.position())[None], len(knots), axis=0)
        if not self._settings.anchored:
            return targets_at(plan, knots + passed)
        self._cost.phase += passed
        while self._cost.phase > 1.0 - 1e-6:  # sums of control steps round
            plan = np.concatenate([plan[1:], self._cost.continued(plan)[None]])
            self._cost.phase -= 1.0
        return plan

    def _samples(self, current: np.ndarray) -> np.ndarray:
        """Plans to try, (samples, knots, nu): the current one, proposals, then variations."""
        settings, law = self._settings, self._law
        proposals = self._proposed(current.shape)
        size = self._budget.size()
        proposals = proposals[: size // 2]
        samples = np.repeat(current[None], size, axis=0)
        proposed, varied = np.split(samples[1:], [len(proposals)])
        proposed[:] = proposals
        if settings.flowing:
            proposed[:, 0, law.follows] = current[0, law.follows]
        # Log-uniform: coarse samples find another path, fine ones bring the last millimetre.
        scales = np.exp(self._random.uniform(np.log(settings.finest), 0.0, len(varied)))
        scales *= law.noise * self._cost.noise_scale
        noise = self._random.standard_normal(varied.shape)
        varied += scales[:, None, None] * law.scale * noise
        samples[1:] = law.within_limits(samples[1:])
        return samples

    def _proposed(self, shape: tuple[int, ...]) -> np.ndarray:
        """The last proposals shifted in time, or new ones if they are due, (n, knots, nu)."""
        stage, knots = self._cost.stage(), np.arange(self._settings.knots)
        if self._uses % self._settings.proposal_interval and stage == self._stage:
            passed = knot_weights(len(knots), knots + self._passed())
            self._proposals = passed @ self._proposals
        else:
            self._proposals = self._new_proposals(shape)
            self._stage, self._uses = stage, 0
        self._uses += 1
        return self._proposals

    def _new_proposals(self, shape: tuple[int, ...]) -> np.ndarray:
        """The cost's proposals that are tried, (n, knots, nu)."""
        returned = self._cost.proposals(self._now, self._random)
        proposals = np.zeros((0, *shape)) if returned is None else np.asarray(returned, float)
        if proposals.shape[1:] != shape:
            raise ValueError(
                f"proposals of {name_of(self._cost)} returned shape {proposals.shape}; "
                f"expected (n, {shape[0]}, {shape[1]}), for {shape[0]} knots (as the planner's "
                "settings say) and the actuators"
            )
        proposals = proposals[: self._settings.samples // 2]
        if not np.isfinite(proposals).all():
            raise ValueError(
                f"proposals of {name_of(self._cost)} returned numbers that are not finite; "
                "expected finite targets"
            )
        return proposals

    def _costs(
        self, rollouts: Rollouts, saved: dict[str, np.ndarray], samples: np.ndarray
    ) -> np.ndarray:
        """The mean cost of following each sample, (samples,); infinite where physics diverges."""
        pace = self._env.control_timestep() / self._settings.spacing
        phases = self._cost.phase + pace * np.arange(self._steps)
        interval = self._settings.cost_interval
        while True:
            rollouts.load(saved)
            diverged = self._follower.follow(rollouts, samples, phases, self._substeps, interval)
            cost = self._step_costs(rollouts).reshape(-1, len(samples)).mean(axis=0)
            if not rollouts.history.is_complete:
                continue  # the cost read fields that are recorded from now on
            unusable = diverged | ~np.isfinite(cost)
            if unusable.all() and not diverged.all():
                raise self._without_a_finite_cost(rollouts, diverged)
            return np.where(unusable, np.inf, cost)

    def _step_costs(self, rollouts: Rollouts) -> np.ndarray:
        """The cost of each recorded state, (states * samples,)."""
        states = rollouts.history.num_envs or 0
        if not self._is_checked:
            self._check_terms(rollouts.seen, states)
        with rows_of_a_batch(states), self._explained(states):
            cost = np.asarray(self._cost.step_cost(rollouts.seen))
        if cost.shape != (states,) or cost.dtype.kind not in "biuf":
            raise ValueError(
                f"step_cost of {name_of(self._cost)} returned shape {cost.shape} and dtype "
                f"{cost.dtype}; expected numbers of shape {(states,)}, one cost for each state"
            )
        return cost

    def _check_terms(self, seen: AnyPhysics, states: int) -> None:
        """Raises ValueError unless each term has one number for each state.

        A term of a class may be one number for all states, as in a stage that lacks it. Of a
        function it is a mistake: a norm or a sum over all states.
        """
        self._is_checked = True
        if type(self._cost).terms is Cost.terms:
            return
        with rows_of_a_batch(states), self._explained(states):
            terms = self._cost.terms(seen)
        shapes = [(states,)] if isinstance(self._cost, FunctionCost) else [(states,), ()]
        for name, term in terms.items():
            found = np.asarray(term)
            what = f"term {name!r} of cost {name_of(self._cost)}"
            if found.dtype.kind not in "biuf":
                raise ValueError(f"{what} has dtype {found.dtype}; expected numbers")
            if found.shape not in shapes:
                raise wrong_shape(what, found.shape, (states,))

    @contextlib.contextmanager
    def _explained(self, states: int) -> Iterator[None]:
        """Explains an error that the cost raises in a batch, and not in a single simulation."""
        try:
            yield
        except NotVectorised:
            raise
        except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError) as error:
            self._cost.step_cost(self._now)  # raises the same error if rows have no part in it
            what = f"cost {name_of(self._cost)}"
            raise raised_in_a_batch(what, error, states) from error

    def _without_a_finite_cost(self, rollouts: Rollouts, diverged: np.ndarray) -> ValueError:
        """The error for a cost that is infinite or NaN in each plan, with the terms that are."""
        states, samples = rollouts.history.num_envs or 0, len(diverged)
        with rows_of_a_batch(states):
            terms = self._cost.weighted_terms(rollouts.seen)
        bad, values = [], ""
        for name, term in terms.items():
            of_plans = np.broadcast_to(term, states).reshape(-1, samples)[:, ~diverged]
            wrong = of_plans[~np.isfinite(of_plans)]
            if wrong.size:
                bad.append(repr(name))
                values = values or f"{wrong[0]}"
        return ValueError(
            f"no plan has a finite cost: {', '.join(bad) or 'step_cost'} of {name_of(self._cost)} "
            f"is {values or 'not finite'}; expected finite numbers"
        )


def _name_of(stage: object) -> str:
    """The text of the first Enum in a stage."""
    if isinstance(stage, enum.Enum):
        return str(stage.value)
    names = map(_name_of, stage) if isinstance(stage, tuple) else iter(())
    return next(filter(None, names), "")


def _check_arguments(
    env: object,
    num_threads: int | None,
    cost: Cost | CostFunction | None,
    settings: Settings | None,
) -> None:
    """Raises ValueError or TypeError for arguments that cannot be planned with."""
    if not isinstance(env, control.Environment):
        inner = getattr(getattr(env, "unwrapped", None), "environment", None)
        instead = "as suite.load returns"
        if isinstance(inner, control.Environment):  # in an environment of Gymnasium's
            instead = "which is env.unwrapped.environment here"
        raise TypeError(
            f"env is of type {type(env).__name__}; expected a limberjack.rl.control.Environment, "
            f"{instead}"
        )
    if num_threads is not None:
        at_least_one("num_threads", num_threads)
    if isinstance(cost, type) or not (cost is None or isinstance(cost, Cost) or callable(cost)):
        raise TypeError(
            f"cost is {_described(cost)}; expected an instance of a subclass of Cost, such as "
            "MyCost(env.task), or a function of physics that returns the cost's terms"
        )
    if settings is not None and not isinstance(settings, Settings):
        raise TypeError(f"settings is {_described(settings)}; expected Settings(...)")
    controls = (env.physics.model.nu,)
    actions = env.action_spec().shape
    if actions != controls or not controls[0]:
        raise ValueError(
            f"actions have shape {actions} and the model {controls[0]} actuators; the planner "
            "expects one action element per actuator, and at least one actuator"
        )


def _described(value: object) -> str:
    return f"{value.__name__} itself" if isinstance(value, type) else type(value).__name__


def _weighted_mean(samples: np.ndarray, costs: np.ndarray, temperature: float) -> np.ndarray:
    """The samples' mean, (knots, nu), where the best count most; the first if none is finite."""
    # Of the best eighth only: bad proposals must not blur the differences between good ones.
    rank = max(1, len(costs) // 8)
    best, worst = costs.min(), np.partition(costs, rank)[rank]
    if not best < worst < np.inf:
        return samples[int(np.argmin(costs))]
    weights = np.exp((best - costs) / (temperature * (worst - best)))
    weights /= weights.sum()
    return (weights[:, None, None] * samples).sum(axis=0)
