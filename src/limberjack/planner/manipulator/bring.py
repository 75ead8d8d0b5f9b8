"""`Bring`: the cost of bring_ball and bring_peg.

The object is fetched first (`fetch.py`). Once it is held, its distance from the target costs. The
quality of the hold is a number between 0 and 1, so that fetching and carrying blend within one
plan. A peg is carried along a joint path, because its own path to the target would not turn it.
"""

from typing import ClassVar

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import ARM, GAIN, LONGEST, PLANE, loose, sag
from limberjack.planner.arm.proposals import Proposal, lifts, straight_to
from limberjack.planner.cost import AnyTask, Cost
from limberjack.planner.manipulator.fetch import Fetch, Stage
from limberjack.planner.manipulator.props import PRESS, Peg, downwards, prop_of

__all__ = ["Bring"]


class Bring(Cost):
    """Cost of fetching the object, and of carrying it to the target."""

    weights: ClassVar = {"hand at the floor": 5.0}

    def __init__(self, task: AnyTask) -> None:
        """Takes a `manipulator.Bring` task."""
        super().__init__(task)
        self.settings = prop_of(task).settings
        self.reset()

    def reset(self) -> None:
        """Discards the stage, the forecast and the paths."""
        self._fetch = Fetch(prop_of(self.task), self.settings)
        self._sag = np.zeros(4)  # radians by which gravity bends the arm away from its targets

    def stage(self) -> tuple[Stage, object]:
        """The stage, and the choices in it."""
        return self._fetch.stage, self._fetch.choices()

    def update(self, physics: Physics) -> None:
        """Decides the stage, and searches for paths of a peg."""
        data, fetch = physics.named.data, self._fetch
        fetch.observe(data)
        fetch.update(physics)
        if isinstance(fetch.prop, Peg):
            self._sag = sag(physics, GAIN)
            if fetch.has:
                self._search_target(fetch.prop, data)

    def _search_target(self, peg: Peg, data: NamedFields) -> None:
        """Searches for a path to the target; for a leaning peg if no other is found."""
        assert self._fetch.paths is not None
        up, draws = -downwards(data.site_xpos["grasp"])[PLANE], self._fetch.approach.draws
        is_found = self._fetch.paths.search_target(
            data.qpos[ARM], up, lambda: peg.poses_at_target(data, draws, 24)
        )
        if not is_found and peg.gap(data) > 0.03:  # metres; a nearer one stays there
            peg.lean()

    def terms(self, physics: Physics) -> dict[str, np.ndarray]:
        """Terms of the stage; those of fetching and carrying are blended by the hold."""
        data, fetch = physics.named.data, self._fetch
        if fetch.stage not in (Stage.CARRY, Stage.FETCH):
            return fetch.terms(data)
        held = fetch.hold(data)
        return {"carry": held * self._carry(physics), **fetch.terms(data, 1.0 - held)}

    def _carry(self, physics: Physics) -> np.ndarray:
        """Cost of a held object's distance from the target, and of what it could be lost by."""
        data, fetch = physics.named.data, self._fetch
        missing = 1.0 - self.task.get_reward(physics)
        carry = fetch.prop.gap(data) / LONGEST + missing
        if fetch.paths is not None:
            carry = fetch.paths.cost_to_target(data.qpos[ARM], carry)
        carry = carry + loose(physics, PRESS)
        for swing in fetch.prop.swung(data):
            carry = carry + swing
        return carry

    def proposals(self, physics: Physics, random: np.random.Generator) -> np.ndarray:
        """Straight joint paths of the stage, above its targets by the arm's sag."""
        data, fetch = physics.named.data, self._fetch
        carrying = self._carrying(data, random) if fetch.stage is Stage.CARRY else []
        found = fetch.plans(data, random, carrying)
        found[..., :4] += self._sag
        return found

    def _carrying(self, data: NamedFields, random: np.random.Generator) -> list[Proposal]:
        """Proposals to the target, upwards, and none."""
        now, shut = data.qpos[ARM], self._fetch.prop.shut
        proposals = straight_to(self._fetch.prop.poses_at_target(data, random, 6), shut, 1, 2, 4)
        return [*proposals, *lifts(random, data, shut), Proposal([now], [shut])]
