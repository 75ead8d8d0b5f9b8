"""`Planner`: sampling-based model-predictive control (MPC).

    planner = Planner(env, seed=0)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(planner.act())

A plan is a spline of targets for the actuators (`spline.py`, `control_law.py`). `Planner.act` does
what a planner of MuJoCo MPC does in three steps:

1. `_set_state`: the environment's full state is read, and the cost updates its stage.
2. `_optimise`: the current plan, random variations of it and the cost's proposals are rolled out in
   a batch from that state. The new plan follows from their costs, as `Settings.optimiser` has it:
   the mean of MPPI (`optimisers/mppi.py`), or the elites of iCEM (`optimisers/icem.py`).
3. `_action`: the control law follows the plan, until `Settings.interval` control steps have passed.
   The next planning step starts from that plan, shifted by the elapsed time.

The planner reads the environment's simulator state, not its observations, and never writes to it.
It knows nothing of the environment's `faults`: it plans as if its actions arrived at once and
unchanged, with the task's own model where a perturbation has changed the environment's.
The same seed gives the same actions for any number of threads, unless a time budget is given.
"""

import enum
import functools
from typing import NamedTuple

import mujoco
import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.simulation import without_calls
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.cost import Cost, CostFunction, FunctionCost, cost_for, name_of
from limberjack.planner.optimisers.base import Search
from limberjack.planner.plan_costs import PlanCosts
from limberjack.planner.planning_model import enable_sleep, planning_model_of
from limberjack.planner.policy_plans import Act, BeginsAlone, PolicyPlans
from limberjack.planner.rollouts import Budget, Rollouts
from limberjack.planner.servos import Servos
from limberjack.planner.settings import Settings
from limberjack.planner.spline import knot_weights, targets_at
from limberjack.rl import control
from limberjack.rl.action_specs import open_bounds
from limberjack.rl.guards import at_least_one
from limberjack.utils.cores import usable_cores

__all__ = ["Explanation", "Planner"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_POLICY_SHARE = 8  # samples for each plan of a policy: one is its own, the others vary around it


class Explanation(NamedTuple):
    """The best plan of a planning step."""

    stage: str  # name of the cost's stage; empty if it has none
    # The cost's weighted terms, each the mean over the plan's steps, and what is terminal.
    terms: dict[str, float]


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
        policy: Act | BeginsAlone | None = None,
    ) -> None:
        """Creates a planner, also before the environment's first reset.

        Args:
          env: a `control.Environment`, of the suite or your own.
          num_threads: number of simulation threads; all usable cores by default.
          seed: seed of the samples; each episode draws the same stream.
          cost: the cost to minimise, or a function that returns its terms; by default the one that
            the environment's task names.
          settings: replace the cost's settings, also in `cost` itself.
          max_ms: milliseconds that a planning step should take, for live use: it tries fewer
            samples if there is no time for all. Actions then depend on the clock and are not
            repeatable. A path search, and a planning step with the fewest samples, may take longer.
          policy: a function from an observation to an action, or a policy of
            `limberjack.policies.find`, whose plans are tried among the samples.

        Raises:
          ValueError: the task names no cost, or a setting does not fit the environment.
          TypeError: `env` is another kind of object, such as a Gymnasium environment; or `cost`,
            `settings` or `policy` is of another kind.
        """
        _check_arguments(env, num_threads, cost, settings)
        self._env, self._seed = env, seed
        if cost is not None and not isinstance(cost, Cost):
            cost = FunctionCost(cost)
        self._cost = cost_for(env.task) if cost is None else cost
        self._settings = settings = self._cost.settings if settings is None else settings
        physics = _nominal_physics(env)
        self._law = self._follower = ControlLaw(physics.model._official, settings)
        self._law.narrow(*open_bounds(env.action_spec()))
        self._budget = Budget(max_ms, settings.samples)
        # The current state, with the environment's own motors for costs that simulate themselves.
        self._now = planning_model_of(physics, settings)
        self._plan_costs = PlanCosts(self._cost, self._now)
        rolled_out = planning_model_of(physics, settings)
        if settings.servos:
            self._follower = Servos(rolled_out.model.ptr, self._law)
        if settings.sleep:
            enable_sleep(rolled_out.model.ptr)
        self._policy = None if policy is None else PolicyPlans(env, policy, self._law, settings)
        self._substeps = control.compute_n_steps(env.control_timestep(), self._now.timestep())
        self._steps = max(1, round(settings.horizon / env.control_timestep()))
        iterations = settings.optimiser.iterations
        states = -(-self._steps // settings.cost_interval)
        threads = usable_cores() if num_threads is None else num_threads
        self._fields = _fields_of_episodes(env)
        self._new_rollouts = functools.partial(
            Rollouts, rolled_out, num_threads=threads, own_fields=self._fields, states=states
        )
        sizes = {max(2, all_ // iterations) for all_ in self._budget.sizes}
        self._rollouts = {size: self._new_rollouts(samples=size) for size in sizes}
        self._cost.settings = settings
        self.reset()

    @property
    def settings(self) -> Settings:
        """The settings in use."""
        return self._settings

    @property
    def cost(self) -> Cost:
        """The cost that plans minimise."""
        return self._cost

    def reset(self) -> None:
        """Discards the current plan, for a new episode."""
        self._cost.reset()
        self._cost.phase = 0.0
        self._random = np.random.default_rng(self._seed)
        self._plan: np.ndarray | None = None  # (knots, nu)
        self._search: Search | None = None  # of the last planning step
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

        Call it once in each control step, as plans are shifted by the steps between calls. A new
        episode is detected by its time, and planning then starts from scratch. Calling again in the
        same state returns the same action.

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
        return Explanation(_name_of(self._cost.stage()), self._plan_costs.terms_of(*self._best))

    def _set_state(self) -> dict[str, np.ndarray]:
        """Updates the cost in the environment's state; returns that state, to be loaded."""
        # The call that led to the state has other time steps here.
        saved = without_calls(self._env.physics.simulation.save(None, self._fields))
        if self._env._ours.faults is not None:
            saved = self._env._ours.faults.unperturbed(saved)
        self._now.simulation.load(saved)
        self._cost.update(self._now)
        return saved

    def _optimise(self, saved: dict[str, np.ndarray]) -> np.ndarray:
        """The plan from a state on, (knots, nu)."""
        settings, law = self._settings, self._law
        current, elites = self._shifted()
        proposals = self._proposed(current.shape, saved)
        size = self._budget.size()
        proposals = proposals[: size // 2].copy()
        if settings.flowing:
            proposals[:, 0, law.follows] = current[0, law.follows]
        self._search = Search(
            current=current,
            proposals=proposals,
            elites=elites,
            scale=law.scale,
            noise=law.noise * self._cost.noise_scale,
            within_limits=law.within_limits,
            random=self._random,
        )
        plan = settings.optimiser.optimise(
            self._search, size, lambda samples: self._costs(saved, samples)
        )
        self._budget.spent(size)
        return plan

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

    def _shifted(self) -> tuple[np.ndarray, np.ndarray]:
        """The current plan, (knots, nu), and the elites, (n, knots, nu), shifted to the time."""
        knots = np.arange(self._settings.knots)
        plan, passed = self._plan, self._passed()
        if plan is None or self._search is None:
            plan = np.repeat(self._law.held(self._now.position())[None], len(knots), axis=0)
            return plan, np.zeros((0, *plan.shape))
        elites = self._search.elites
        if not self._settings.anchored:
            later = knots + passed
            return targets_at(plan, later), knot_weights(len(knots), later) @ elites
        self._cost.phase += passed
        while self._cost.phase > 1.0 - 1e-6:  # sums of control steps round
            plan = self._continued(plan)
            elites = np.array([self._continued(elite) for elite in elites]).reshape(elites.shape)
            self._cost.phase -= 1.0
        return plan, elites

    def _continued(self, plan: np.ndarray) -> np.ndarray:
        """An anchored plan from its second knot on, with one more knot."""
        return np.concatenate([plan[1:], self._cost.continued(plan)[None]])

    def _proposed(self, shape: tuple[int, ...], saved: dict[str, np.ndarray]) -> np.ndarray:
        """The last proposals shifted in time, or new ones if they are due, (n, knots, nu)."""
        stage, knots = self._cost.stage(), np.arange(self._settings.knots)
        if self._uses % self._settings.proposal_interval and stage == self._stage:
            passed = knot_weights(len(knots), knots + self._passed())
            self._proposals = passed @ self._proposals
        else:
            self._proposals = self._new_proposals(shape)
            if self._policy is not None:
                of_policy = self._plans_of_policy(self._policy, saved)
                self._proposals = np.concatenate([of_policy, self._proposals])
            self._stage, self._uses = stage, 0
        self._uses += 1
        return self._proposals

    def _plans_of_policy(self, policy: PolicyPlans, saved: dict[str, np.ndarray]) -> np.ndarray:
        """Plans of the policy from a saved state, (n, knots, nu)."""
        self._now.simulation.load(saved)
        count = max(1, self._settings.samples // _POLICY_SHARE)
        plans = policy.from_state(self._now, self._phases(), count, self._random)
        self._now.simulation.load(saved)
        return plans

    def _phases(self) -> np.ndarray:
        """The phases of the control steps up to the horizon, (steps,)."""
        pace = self._env.control_timestep() / self._settings.spacing
        return self._cost.phase + pace * np.arange(self._steps)

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

    def _costs(self, saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        """The cost of following each sample, (samples,); infinite where physics diverges."""
        rollouts = self._rollouts.get(len(samples))
        if rollouts is None:  # of an optimiser with other numbers of samples
            rollouts = self._new_rollouts(samples=len(samples))
            self._rollouts[len(samples)] = rollouts
        phases = self._phases()
        interval = self._settings.cost_interval
        costs = None
        while costs is None:  # the cost has read fields that are recorded from now on
            rollouts.load(saved)
            diverged = self._follower.follow(rollouts, samples, phases, self._substeps, interval)
            costs = self._plan_costs.of(rollouts, diverged)
        self._best = rollouts, int(np.argmin(costs))
        return costs


def _nominal_physics(env: control.Environment) -> Physics:
    """The environment's physics; with perturbations a copy that has the task's own model."""
    faults = env._ours.faults
    if faults is None or not faults.nominal:
        return env.physics
    physics = env.physics.copy()
    physics.simulation.set_fields(faults.nominal)
    return physics


def _fields_of_episodes(env: control.Environment) -> tuple[str, ...]:
    """Names of the model fields that starts set, without those that only a perturbation sets."""
    own = getattr(env.task, "EPISODE_FIELDS", ())
    faults = env._ours.faults
    only_perturbed = {*faults.fields} - {*own} if faults is not None else set()
    return tuple(name for name in env._saved_fields() if name not in only_perturbed)


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
    repeat = env._ours.action_repeat
    if repeat != 1:
        raise ValueError(
            f"the environment has action_repeat={repeat}, but the planner acts at every control "
            "step: leave action_repeat at 1"
        )
    controls = (env.physics.model.nu,)
    actions = env.action_spec().shape
    if actions != controls or not controls[0]:
        raise ValueError(
            f"actions have shape {actions} and the model {controls[0]} actuators; the planner "
            "expects one action element per actuator, and at least one actuator"
        )


def _described(value: object) -> str:
    return f"{value.__name__} itself" if isinstance(value, type) else type(value).__name__
