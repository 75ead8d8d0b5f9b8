"""`Planner`: sampling-based model-predictive control (MPC).

    planner = Planner(env, seed=0)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(planner.act())

A plan is a spline of targets for the actuators (`spline.py`, `control_law.py`). At each planning
step, the current plan, random variations of it and the cost's proposals are rolled out in a batch
from the environment's full state. The new plan is their mean, weighted so that low costs count most
(MPPI: Williams et al., 2017, "Information theoretic MPC"). The next planning step starts from that
plan, shifted by the elapsed time.

The planner reads the environment's simulator state, not its observations, and never writes to it.
The same seed gives the same actions for any number of threads, unless a time budget is given.
"""

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from limberjack.mujoco.simulation import NOT_FIELDS
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.cost import Cost, cost_for
from limberjack.planner.history import History
from limberjack.planner.planning_model import enable_sleep, planning_model_of
from limberjack.planner.rollouts import Budget, Rollouts, state_of
from limberjack.planner.servos import Servos
from limberjack.planner.settings import Settings
from limberjack.planner.spline import knot_weights, targets_at
from limberjack.rl import control
from limberjack.rl.guards import at_least_one
from limberjack.utils.arrays import rows_of_a_batch
from limberjack.utils.cores import usable_cores

__all__ = ["Explanation", "Planner"]


class Explanation(NamedTuple):
    """The best plan of a planning step."""

    stage: str  # name of the cost's stage; empty if it has none
    terms: dict[str, float]  # the cost's weighted terms, each the mean over the plan's steps


class _Simulated(NamedTuple):
    """The rollouts of so many samples, and the states that the cost sees."""

    batch: Rollouts
    history: History
    seen: Any


class Planner:
    """Chooses actions for one environment; see the module's docstring."""

    def __init__(
        self,
        env: Any,
        num_threads: int | None = None,
        seed: int = 0,
        cost: Cost | None = None,
        settings: Settings | None = None,
        max_ms: float | None = None,
    ) -> None:
        """Creates a planner, also before the environment's first reset.

        Args:
          env: a `control.Environment`, of the suite or your own.
          num_threads: number of simulation threads; all usable cores by default.
          seed: seed of the samples; each episode draws the same stream.
          cost: the cost to minimise; by default the one that the environment's task names.
          settings: replace the cost's settings.
          max_ms: milliseconds that a planning step should take, for live use: it tries fewer
            samples if there is no time for all. Actions then depend on the clock and are not
            repeatable. A path search, and a planning step with the fewest samples, may take longer.

        Raises:
          ValueError: the task names no cost, or a setting does not fit the environment.
          TypeError: `env` is another kind of object, such as a Gymnasium environment; or `cost` or
            `settings` is not an instance of its class.
        """
        if not isinstance(env, control.Environment):
            raise TypeError(
                f"env is of type {type(env).__name__}; expected a limberjack.rl.control."
                "Environment, as suite.load returns"
            )
        _check_arguments(env, num_threads, cost, settings)
        self._env = env
        self._cost = cost_for(env.task) if cost is None else cost
        self._settings = self._cost.settings if settings is None else settings
        self._seed = seed
        threads = usable_cores() if num_threads is None else num_threads
        law = self._settings.gain, self._settings.damping, self._settings.tendons
        self._law = ControlLaw(env.physics.model._model, *law)
        self._servos: Servos | None = None
        self._spacing = self._settings.spacing
        self._steps = max(1, round(self._settings.horizon / env.control_timestep()))
        samples = self._settings.samples
        parts = (1,) if max_ms is None else (1, 2, 4, 8)
        sizes = sorted({max(2, samples // part) for part in parts})
        self._budget = None if max_ms is None else Budget(max_ms, sizes)
        self._made, self._now, self._substeps = self._make_rollouts(sizes, threads)
        self._size = samples  # of the last planning step
        self.reset()

    @property
    def settings(self) -> Settings:
        """The settings in use."""
        return self._settings

    def reset(self) -> None:
        """Discards the current plan, for a new episode."""
        self._cost.reset()
        self._random = np.random.default_rng(self._seed)
        self._plan: np.ndarray | None = None  # (knots, nu)
        self._last_proposals, self._stage = np.zeros((0, 0, 0)), None
        # Planning steps since they were made: the first ones are due.
        self._plannings = self._settings.proposal_interval
        self._cost.phase = 0.0
        self._best: int | None = None  # sample of the last planning step
        self._age = 0  # control steps since the plan was made
        self._time = -np.inf
        self._state: np.ndarray | None = None  # the simulator's, at that time
        self._action = np.zeros(0)  # for that state

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
        time, state = physics.time(), physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)
        if time <= self._time:
            if self._state is not None and np.array_equal(state, self._state):
                return self._action.copy()
            self.reset()
        plan = self._plan
        if plan is None or self._age >= self._settings.interval:
            plan = self._plan = self._improved()
            self._age = 0
        targets = targets_at(plan, self._cost.phase + self._passed())
        self._age += 1
        self._cost.followed(targets)
        self._action = self._law.controls(targets, physics.position(), physics.velocity())
        self._time, self._state = time, state
        return self._action.copy()

    def explain(self) -> Explanation:
        """The stage, and the cost's terms for the best plan of the last planning step.

        A cost that defines `step_cost` alone has the one term 'cost'.

        Raises:
          RuntimeError: nothing has been planned yet in this episode.
        """
        if self._best is None:
            raise RuntimeError("nothing has been planned: call planner.act() before explain()")
        _, history, seen = self._made[self._size]
        cost, states = self._cost, history.num_envs or 0
        with rows_of_a_batch(states):
            if type(cost).terms is Cost.terms:
                terms = {"cost": cost.step_cost(seen)}
            else:
                terms = cost.weighted_terms(seen)
        best = slice(self._best, None, self._size)
        means = {n: float(np.broadcast_to(t, states)[best].mean()) for n, t in terms.items()}
        return Explanation(_name_of(cost.stage()), means)

    def _passed(self) -> float:
        """Knots since the current plan was made."""
        return self._age * self._env.control_timestep() / self._spacing

    def _make_rollouts(
        self, sizes: Sequence[int], threads: int
    ) -> tuple[dict[int, _Simulated], Any, int]:
        """Rollouts by size, a simulation of the current state, and time steps per control step.

        The simulation has the environment's own motors, for costs that simulate themselves.
        """
        env, settings = self._env, self._settings
        fields = self._fields = tuple(n for n in env.snapshot().physics if n not in NOT_FIELDS)
        twin = planning_model_of(env.physics, settings)
        if settings.servos:
            self._servos = Servos(twin.model.ptr, self._law)
        if settings.sleep:
            enable_sleep(twin.model.ptr)
        looks = -(-self._steps // settings.cost_interval)
        made = {}
        for size in sizes:
            batch = Rollouts(twin, size, threads, fields)
            history = History(batch.simulation, looks)
            made[size] = _Simulated(batch, history, batch.physics.seen_through(history))
        is_the_same = not settings.servos and not settings.sleep
        single = made[settings.samples].batch.single
        now = single if is_the_same else planning_model_of(env.physics, settings)
        return made, now, control.compute_n_steps(env.control_timestep(), twin.timestep())

    def _improved(self) -> np.ndarray:
        """The plan from now on, (knots, nu)."""
        budget = self._budget
        if budget is not None:
            budget.begin()
        saved = state_of(self._env.physics, self._fields)
        now = self._now
        now.simulation.load(saved)
        self._cost.update(now)
        samples = self._samples(now)
        costs = self._costs(saved, samples)
        if budget is not None:
            budget.spent(self._size)
        self._best = int(np.argmin(costs))
        return _weighted_mean(samples, costs, self._settings.temperature)

    def _samples(self, now: Any) -> np.ndarray:
        """Plans to try, (samples, knots, nu): the current one, proposals, then variations."""
        settings, law = self._settings, self._law
        present = self._shifted(now)
        proposals = self._proposed(now, present.shape)
        if self._budget is not None:
            self._size = self._budget.size()
            proposals = proposals[: self._size // 2]
        samples = np.repeat(present[None], self._size, axis=0)
        taken = len(proposals)
        samples[1 : 1 + taken] = proposals
        if settings.flowing:
            samples[1 : 1 + taken, 0, law.follows] = present[0, law.follows]
        varied = samples[1 + taken :]
        fineness = np.log(settings.finest)
        # Log-uniform: coarse samples find another way, fine ones bring the last millimetre.
        widths = np.exp(self._random.uniform(fineness, 0.0, len(varied)))
        widths *= settings.noise * self._cost.noise_scale
        noise = self._random.standard_normal(varied.shape)
        varied += widths[:, None, None] * law.scale * noise
        samples[1:] = law.within_limits(samples[1:])
        return samples

    def _proposed(self, now: Any, shape: tuple[int, ...]) -> np.ndarray:
        """The last proposals shifted in time, or new ones if they are due, (n, knots, nu)."""
        stage, knots = self._cost.stage(), shape[0]
        self._plannings += 1
        if self._plannings < self._settings.proposal_interval and stage == self._stage:
            passed = knot_weights(knots, np.arange(knots) + self._passed())
            self._last_proposals = passed @ self._last_proposals
        else:
            self._last_proposals = self._proposals(now, shape)
            self._stage, self._plannings = stage, 0
        return self._last_proposals

    def _proposals(self, now: Any, shape: tuple[int, ...]) -> np.ndarray:
        """The cost's proposals that are tried, (n, knots, nu)."""
        returned = self._cost.proposals(now, self._random)
        if returned is None:
            return np.zeros((0, *shape))
        proposals = np.asarray(returned, float)
        if proposals.shape[1:] != shape:
            raise ValueError(
                f"proposals of {type(self._cost).__name__} returned shape {proposals.shape}; "
                f"expected (n, {shape[0]}, {shape[1]}), for {shape[0]} knots (as the planner's "
                "settings say) and the actuators"
            )
        proposals = proposals[: self._settings.samples // 2]
        if not np.isfinite(proposals).all():
            raise ValueError(
                f"proposals of {type(self._cost).__name__} returned numbers that are not finite; "
                "expected finite targets"
            )
        return proposals

    def _shifted(self, now: Any) -> np.ndarray:
        """The current plan shifted to the current time, (knots, nu)."""
        knots = np.arange(self._settings.knots)
        plan, passed = self._plan, self._passed()
        if plan is None:
            return np.repeat(self._law.held(now.position())[None], len(knots), axis=0)
        if not self._settings.anchored:
            return targets_at(plan, knots + passed)
        self._cost.phase += passed
        while self._cost.phase > 1.0 - 1e-6:  # sums of control steps round
            plan = np.concatenate([plan[1:], self._cost.continued(plan)[None]])
            self._cost.phase -= 1.0
        return plan

    def _costs(self, saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        """The cost of following each sample, (samples,); infinite where physics diverges."""
        while True:
            diverged = self._simulate(saved, samples)
            cost = self._judged(len(samples))
            if self._made[self._size].history.is_complete:
                return np.where(diverged, np.inf, cost)
            # The cost read fields that are recorded from now on.

    def _simulate(self, saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        """Follows each sample from the saved state; returns where physics diverges, (samples,)."""
        law, (batch, history, _) = self._law, self._made[self._size]
        history.begin()
        pace = self._env.control_timestep() / self._spacing
        places = self._cost.phase + pace * np.arange(self._steps)
        batch.load(saved)
        if self._servos is not None:
            when = self._substeps, self._settings.cost_interval
            return self._servos.follow(batch, history, samples, places, *when)
        qpos, qvel = batch.physics.data.qpos, batch.physics.data.qvel
        batch.forget_divergence()
        for step, targets in enumerate(targets_at(samples, places), 1 - self._steps):
            batch.physics.set_control(law.controls(targets, qpos, qvel))
            batch.step(self._substeps)
            # Counted from the end, so that the last state counts.
            if step % self._settings.cost_interval == 0:
                history.record(step // self._settings.cost_interval - 1)
        return batch.diverged()

    def _judged(self, count: int) -> np.ndarray:
        """The mean cost of each sample's rollout, (count,)."""
        _, history, seen = self._made[self._size]
        states = history.num_envs or 0
        with rows_of_a_batch(states):
            cost = np.asarray(self._cost.step_cost(seen))
        if cost.shape != (states,) or cost.dtype.kind not in "biuf":
            raise ValueError(
                f"step_cost of {type(self._cost).__name__} returned shape {cost.shape} and dtype "
                f"{cost.dtype}; expected numbers of shape {(states,)}, one cost for each state"
            )
        return cost.reshape(-1, count).mean(axis=0)


def _name_of(stage: Any) -> str:
    """The text of the first Enum in a stage."""
    if isinstance(stage, enum.Enum):
        return str(stage.value)
    names = map(_name_of, stage) if isinstance(stage, tuple) else iter(())
    return next(filter(None, names), "")


def _check_arguments(
    env: Any, num_threads: int | None, cost: Cost | None, settings: Settings | None
) -> None:
    """Raises ValueError or TypeError for arguments that cannot be planned with."""
    if num_threads is not None:
        at_least_one("num_threads", num_threads)
    for name, value, kind in (("cost", cost, Cost), ("settings", settings, Settings)):
        if value is not None and not isinstance(value, kind):
            given = f"{value.__name__} itself" if isinstance(value, type) else type(value).__name__
            made = "an instance of a subclass, such as MyCost(env.task)"
            expected = made if kind is Cost else "Settings(...)"
            raise TypeError(f"{name} is {given}; expected {expected}")
    controls = (env.physics.model.nu,)
    actions = env.action_spec().shape
    if actions != controls or not controls[0]:
        raise ValueError(
            f"actions have shape {actions} and the model {controls[0]} actuators; the planner "
            "expects one action element per actuator, and at least one actuator"
        )


def _weighted_mean(samples: np.ndarray, costs: np.ndarray, temperature: float) -> np.ndarray:
    """The samples' mean, (knots, nu), where the best count most; the first if none is finite."""
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = costs.min()
    if not np.isfinite(best):
        return samples[0]
    # Of the best eighth only: bad proposals must not blur the differences between good ones.
    rank = max(1, len(costs) // 8)
    spread = np.partition(costs, rank)[rank] - best
    if not np.isfinite(spread) or spread <= 0:
        return samples[int(np.argmin(costs))]
    weights = np.exp((best - costs) / (temperature * spread))
    weights /= weights.sum()
    return (weights[:, None, None] * samples).sum(axis=0)
