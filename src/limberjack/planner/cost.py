"""`Cost`: the quantity that plans minimise, as named and weighted terms of a batch of states.

    class Crouch(Cost):
        settings = Settings(horizon=0.4, gain=1.5)
        weights: ClassVar = {"height": 1.0, "motion": 0.01}

        def terms(self, physics):
            return {
                "height": physics.head_height(),
                "motion": np.abs(physics.velocity()).mean(axis=-1),
            }

    planner = Planner(env, cost=Crouch(env.task))

`terms` receives a batch of the environment's own `Physics`, so all measurements of the domain and
the task, including `task.get_reward(physics)`, are available with the states as leading axis. It
receives all states of all plans at once, because NumPy takes hardly longer for many.

A plain function of the physics that returns such terms, or their sum, is a cost too:

    planner = Planner(env, cost=lambda physics: {"height": physics.head_height()})

A task names its cost in `planner_cost`, as "module:Class" or "module:function"; `cost_for(task)`
makes one.
"""

import ast
import importlib
import inspect
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from limberjack.planner.settings import Settings
from limberjack.utils.arrays import Quantity
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "AnyPhysics",
    "AnyTask",
    "Cost",
    "CostFunction",
    "FunctionCost",
    "cost_for",
    "name_of",
    "sources_for",
]

# Any: of the domain's own classes, whose methods a cost calls.
AnyPhysics = Any
AnyTask = Any

# Of N states as a batch of simulations, to the cost's terms by name or their sum, (N,) each.
CostFunction = Callable[[AnyPhysics], Mapping[str, Quantity] | np.ndarray]


class Cost:
    """The quantity that plans minimise; see the module's docstring.

    A subclass must define `terms`, or `step_cost` instead. The other methods are for tasks with
    stages or with known good plans.

    Attributes:
      settings: of the planner; it sets here those that it was given.
      weights: the weight of each term; terms that are not named weigh 1.
      noise_scale: noise scale of variations, as a fraction of the settings' noise; `update` may set
        it.
      phase: of the current time in an anchored plan, in knots; the planner sets it.
    """

    settings = Settings()
    weights: ClassVar[Mapping[str, float]] = {}
    noise_scale = 1.0
    phase = 0.0

    def __init__(self, task: AnyTask) -> None:
        """Stores the environment's task, whose reward terms the cost may use."""
        self.task = task

    def reset(self) -> None:
        """Called at the start of each episode, to reset stages."""

    def update(self, physics: AnyPhysics) -> None:
        """Called before each planning step, to update the stage.

        Args:
          physics: a single simulation in the environment's current state. It belongs to the
            planner, so it may be read, modified and stepped.
        """

    def terms(self, physics: AnyPhysics) -> Mapping[str, Quantity]:
        """The cost's terms before they are weighted, by name, (N,) each.

        It may be called more than once for the same states.

        Args:
          physics: N states from rollouts of plans, as a batch of simulations. Read-only; the terms
            of a state must not depend on the other states.
        """
        return {"cost": self.step_cost(physics)}

    def step_cost(self, physics: AnyPhysics) -> np.ndarray:
        """The cost of each state, (N,): the weighted sum of the terms.

        A plan's cost is the mean over the control steps at which it is computed.
        """
        if type(self).terms is Cost.terms:
            raise NotImplementedError(
                f"{type(self).__name__} defines neither terms(physics), which returns the cost's "
                "terms by name, nor step_cost(physics), which returns the cost of each state of a "
                "batch, shape (N,)"
            )
        return np.asarray(sum(self.weighted_terms(physics).values(), start=0.0))

    def weighted_terms(self, physics: AnyPhysics) -> dict[str, Quantity]:
        """The terms times their weights, by name, (N,) each.

        Raises:
          ValueError: no term has the name of a weight. A cost with stages may have terms in some of
            them only, so its weights are not compared.
        """
        terms = self.terms(physics)
        if type(self).stage is Cost.stage and not self.weights.keys() <= terms.keys():
            name = next(name for name in self.weights if name not in terms)
            raise ValueError(
                f"weights of {name_of(self)} name {name!r}, which is none of its terms: "
                f"{', '.join(terms)}.{did_you_mean(name, terms)}"
            )
        return {name: self.weights.get(name, 1.0) * term for name, term in terms.items()}

    def weigh(self, name: str, weight: float) -> None:
        """Gives a term another weight in this cost, from the next planning step on.

        Raises:
          ValueError: the weight is negative or not finite.
        """
        if not (math.isfinite(weight) and weight >= 0):
            raise ValueError(f"weight of {name!r} is {weight}; expected 0 or a positive number")
        vars(self)["weights"] = {**self.weights, name: float(weight)}  # the class keeps its own

    def terminal(self, physics: AnyPhysics) -> np.ndarray | None:
        """Cost of what follows a plan's horizon, such as a learned value, (N,); None for nothing.

        It is added to the mean of the plan's step costs.

        Args:
          physics: the N last states of rollouts of plans, as for `terms`.
        """
        return None

    def proposals(self, physics: AnyPhysics, random: np.random.Generator) -> np.ndarray | None:
        """Plans to try in addition to variations of the current one, (n, knots, nu), or None.

        Args:
          physics: a single simulation, as for `update`.
          random: the planner's stream.

        Returns:
          Targets of the actuators at the knots: an angle in radians for an actuator on a joint, the
          control for others. They fill at most half of the samples; surplus ones are ignored.
        """
        return None

    def stage(self) -> object:
        """The stage on which proposals depend in addition to the state; compared by `==`.

        While the stage stays the same, proposals may be reused; see `Settings.proposal_interval`.
        """
        return None

    def continued(self, plan: np.ndarray) -> np.ndarray:
        """The targets of the knot after the last one of an anchored plan (knots, nu), (nu,).

        By default those of the last one. Called when the time of the first knot has passed.
        """
        return plan[-1]

    def followed(self, targets: np.ndarray) -> None:
        """Called at each control step with the current targets, (nu,)."""


class FunctionCost(Cost):
    """The cost that a plain function returns; all settings have their defaults."""

    def __init__(self, function: CostFunction) -> None:
        """Takes the function."""
        super().__init__(None)
        self.function = function

    def terms(self, physics: AnyPhysics) -> Mapping[str, Quantity]:
        """The function's terms; a sum is the one term 'cost'."""
        found = self.function(physics)
        return found if isinstance(found, Mapping) else {"cost": found}


def name_of(cost: Cost) -> str:
    """A cost's name in messages: that of its class or its function."""
    defined = cost.function if isinstance(cost, FunctionCost) else type(cost)
    return getattr(defined, "__name__", type(defined).__name__)


def cost_for(task: object) -> Cost:
    """An instance of the cost that a task names in `planner_cost`.

    Raises:
      ValueError: the task names no cost, or one that cannot be found; the message has advice.
    """
    name, kind = getattr(task, "planner_cost", None), type(task).__name__
    if name is None:
        raise ValueError(
            f"the planner knows no cost for tasks of type {kind}: write a subclass of "
            "limberjack.planner.Cost whose terms(physics) returns named terms of each state of a "
            "batch, {name: (N,)}, or a function of physics that does, and pass it as "
            "Planner(env, cost=...), or name it in the task as planner_cost = 'module:name'; see "
            "docs/planner.md and examples/planner_cost.py"
        )
    module, _, named = str(name).partition(":")
    try:
        found = getattr(importlib.import_module(module), named)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"planner_cost of {kind} is {name!r}; expected 'module:Class' of a "
            f"limberjack.planner.Cost, or 'module:function': {error}"
        ) from error
    if isinstance(found, type) and issubclass(found, Cost):
        return found(task)
    if not inspect.isfunction(found):
        raise ValueError(
            f"planner_cost of {kind} is {name!r}, not a subclass of limberjack.planner.Cost and "
            "not a function"
        )
    return FunctionCost(found)


def sources_for(task: object) -> list[Path]:
    """Source files on which plans for a task depend, its cost's files last if outside the planner.

    These are the modules at the planner's top level, the cost's module, that of the function that
    it wraps, and all that they import from the planner's package: a change of another task's cost
    leaves them as they are.

    Raises:
      ValueError: see `cost_for`.
    """
    package = Path(__file__).parent.resolve()
    cost = cost_for(task)
    defined = cost.function if isinstance(cost, FunctionCost) else type(cost)
    named = (defined, inspect.unwrap(defined))  # a decorator may stand in another file
    own = [Path(inspect.getfile(of)).resolve() for of in named]  # pyright: ignore[reportArgumentType]
    files, due = set[Path](), [*package.glob("*.py"), *own]
    while due:
        file = due.pop()
        if file not in files:
            files.add(file)
            due.extend(_imported(file, package))
    return sorted(files, key=lambda file: (not file.is_relative_to(package), file))


def _imported(file: Path, package: Path) -> list[Path]:
    """The files of the planner's package that a file imports."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names += [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [str(node.module), *(f"{node.module}.{name.name}" for name in node.names)]
    inside = [name.split(".")[2:] for name in names if name.startswith("limberjack.planner.")]
    found = [package.joinpath(*parts).with_suffix(".py") for parts in inside]
    return [file for file in found if file.is_file()]
