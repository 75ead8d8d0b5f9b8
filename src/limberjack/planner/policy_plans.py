"""`PolicyPlans`: plans of a policy's own, for the planner to try among its samples.

    plans = PolicyPlans(env, policy, law, settings)
    plans.from_state(physics, phases, 8, random)  # (8, knots, nu)

The policy acts in the planning model from the present state to the horizon. The first plan is the
spline that comes closest to its targets, and the others are variations of it. The planner takes up
as much of them as their costs deserve, so that a policy that is wrong somewhere does no harm.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

import dm_env
import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.settings import Settings
from limberjack.planner.spline import knot_weights
from limberjack.rl import control
from limberjack.rl.memory import stand_in
from limberjack.rl.observations import FLAT_OBSERVATION_KEY, flatten_observation

__all__ = ["Act", "BeginsAlone", "PolicyPlans"]

Act = Callable[[Mapping[str, np.ndarray]], np.ndarray]  # from an observation to an action

# Noise of the variations, as a fraction of the largest noise: from much less than a policy's error
# to about as much.
_FINEST, _COARSEST = 0.03, 0.3


class BeginsAlone(Protocol):
    """A policy of `limberjack.policies`, as `find` returns it."""

    def begin_alone(self, environment: dm_env.Environment, seed: int, /) -> Act:
        """Begins an episode in an environment."""
        ...


class PolicyPlans:
    """Plans that follow a policy; see the module's docstring."""

    def __init__(
        self,
        env: control.Environment,
        policy: Act | BeginsAlone,
        law: ControlLaw,
        settings: Settings,
    ) -> None:
        """Takes the environment in which the policy would act, and the law that follows plans.

        Raises:
          TypeError: the policy is neither a function of an observation nor a policy of `find`.
          ValueError: the environment's observations are pictures, or its world is not the task's.
        """
        if isinstance(policy, type) or not (callable(policy) or hasattr(policy, "begin_alone")):
            raise TypeError(
                f"policy is of type {type(policy).__name__}; expected a function from an "
                "observation to an action, or a policy of limberjack.policies.find"
            )
        if control.Environment.pixels.of(env) is not None:
            raise ValueError("the environment observes pictures, which a plan does not draw")
        if "faults" in (control.Environment.world.of(env) or {}):
            raise ValueError("the environment has faults, which a plan does not simulate")
        self._env, self._policy, self._law = env, policy, law
        self._knots, self._spread = settings.knots, law.noise * law.scale
        self._is_flat = list(env.observation_spec()) == [FLAT_OBSERVATION_KEY]

    def from_state(
        self,
        physics: Physics,
        phases: np.ndarray,
        count: int,
        random: np.random.Generator,
    ) -> np.ndarray:
        """As many plans from a single simulation's state, (count, knots, nu).

        None of them if the policy's actions make the simulation diverge.

        Args:
          physics: with the planning model; it is stepped.
          phases: of the control steps in a plan, (steps,).
          count: number of plans.
          random: the stream of the variations.

        Raises:
          ValueError: the policy returned something other than a finite action.
        """
        substeps = control.compute_n_steps(self._env.control_timestep(), physics.timestep())
        act, targets = self._begun(), []
        try:
            for _ in phases:
                action = self._checked(act(self._observation(physics)))
                targets.append(self._law.targets_of(action, physics.position(), physics.velocity()))
                physics.set_control(action)
                physics.step(substeps)
        except control.PhysicsError:
            return np.zeros((0, self._knots, len(self._spread)))
        plans = np.repeat(_spline_of(np.array(targets), phases, self._knots)[None], count, axis=0)
        scales = np.exp(random.uniform(np.log(_FINEST), np.log(_COARSEST), count - 1))
        noise = random.standard_normal((count - 1, *plans.shape[1:]))
        plans[1:] += scales[:, None, None] * self._spread * noise
        return plans

    def _begun(self) -> Act:
        """The policy at the beginning of an episode, as one that repeats actions counts steps."""
        begin = getattr(self._policy, "begin_alone", None)
        return self._policy if begin is None else begin(self._env, 0)  # pyright: ignore[reportReturnType]

    def _observation(self, physics: Physics) -> Mapping[str, np.ndarray]:
        with stand_in(self._env.task, physics) as task:
            observation = task.get_observation(physics)
        return flatten_observation(observation) if self._is_flat else observation

    def _checked(self, action: object) -> np.ndarray:
        found = np.asarray(action, float)
        expected = self._spread.shape
        if found.shape != expected or not np.isfinite(found).all():
            raise ValueError(
                f"the policy returned {action!r}; expected finite numbers of shape {expected}"
            )
        return found


def _spline_of(targets: np.ndarray, phases: np.ndarray, knots: int) -> np.ndarray:
    """The spline closest to targets at phases, (steps, nu), by least squares, (knots, nu).

    Knots that the phases do not determine have the target of the nearest phase.
    """
    nearest = np.abs(phases[None] - np.arange(knots)[:, None]).argmin(axis=1)
    plan, weights = targets[nearest], knot_weights(knots, phases)
    return plan + np.linalg.pinv(weights) @ (targets - weights @ plan)
