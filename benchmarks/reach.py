"""Reachability: the share of starts of the arm's tasks in which the hand can solve the task.

    python benchmarks/reach.py [--episodes 1000] [--json FILE]

In each episode the objects fall for two seconds without control. For their final poses, inverse
kinematics searches for joint angles that put the fingers around the object (`taken`), or else a
fingertip behind it, to rake it inwards (`raked`), and for joint angles that put the object at the
target in the same grip (`brought`), where a peg that is not inserted may lean as far as the full
reward allows. Joint limits, floor and walls are respected, and the upper arm where it leaves a ball
no room at its target; other objects are ignored. `cap` is the resulting bound on the return: 1,000
for each start whose object can be taken or raked, and brought, and the return of zero actions for
others. An arm that catches a falling object can exceed it.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import sources
import typer

from limberjack import suite
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import PLANE, TIP_ASIDE, TIP_REACH
from limberjack.planner.arm.kinematics import GRASP, PINCH, angle_of, hand_poses

__all__ = ["main", "measure"]

_TASKS = [task for task in suite.ALL_TASKS if task[0] in ("manipulator", "stacker")]
_FALL = 200  # control steps of 10 ms
_FULL = 1_000.0
_TRIES = 32  # number of poses to search
_ROUGHLY, _EXACTLY = 0.5, 0.1  # radians between the hand and the object, before and after
_LEANING = 0.4  # radians; maximum tilt of a peg at the target with full reward
_DOWN, _STEEP = np.array([0.0, -1.0]), 0.5
_ABOVE = 0.045  # metres; height of the fingertips' site above the centre of a box that is held
_BASE = np.array([0.0, GEOMETRY.base_height])
# Metres from the base, about which the upper arm turns. Of a nearer target the ball (22 mm) cannot
# be within the 10 mm of the full reward.
_BESIDE_BASE = GEOMETRY.radii[0] + 0.022 - 0.01
_BEHIND = np.array([0.03, 0.02])  # metres; offset outwards and upwards for raking an object

_Places = dict[str, np.ndarray]  # positions of the sites, (2,) each
_Reaches = Callable[..., bool]


def measure(domain: str, task: str, episodes: int, zero_returns: Sequence[float]) -> dict[str, Any]:
    """Reachability statistics for the episodes with seeds from 0.

    Args:
      domain: the domain's name.
      task: the task's name.
      episodes: number of episodes.
      zero_returns: returns of zero actions, for each seed.
    """
    batch = suite.load_batch(domain, task, episodes, seed=0)
    batch.reset()
    still = np.zeros(batch.action_spec().shape)
    for _ in range(_FALL):
        batch.step(still)
    sites = batch.physics.named.data.site_xpos
    names = sites.axes.row.names
    places = sites[names][..., PLANE]
    random = np.random.default_rng(0)
    within = _stacker if domain == "stacker" else _manipulator
    found = np.array(
        [within(batch.task, dict(zip(names, row, strict=True)), _reaches(random)) for row in places]
    )
    batch.close()
    takes, rakes, brings = found.T
    best = np.where((takes | rakes) & brings, _FULL, zero_returns)
    return {
        "domain": domain,
        "task": task,
        "episodes": episodes,
        "taken": float(takes.mean()),
        "raked": float((rakes & ~takes).mean()),
        "brought": float(brings.mean()),
        "cap": float(best.mean()),
    }


def _reaches(random: np.random.Generator) -> _Reaches:
    """A predicate: whether a site of the hand can be at a point, at an angle within a tolerance."""
    return lambda point, forward, angle=None, tilt=np.pi, lateral=0.0: (
        len(hand_poses(random, point, forward, np.zeros(4), _TRIES, angle, tilt, lateral)) > 0
    )


def _raked(place: np.ndarray, reaches: _Reaches) -> bool:
    behind = place + _BEHIND * [np.sign(place[0]), 1.0]
    return reaches(behind, TIP_REACH, lateral=TIP_ASIDE)


def _manipulator(task: Any, places: _Places, reaches: _Reaches) -> tuple[bool, bool, bool]:
    """Whether the object can be taken (a peg by its handle), whether raked, whether brought."""
    place = places["peg" if task._use_peg else "ball"]
    rakes = _raked(place, reaches)
    if not task._use_peg:
        target = places["target_ball"]
        has_room = bool(np.linalg.norm(target - _BASE) > _BESIDE_BASE)
        return reaches(place, PINCH), rakes, reaches(target, PINCH) and has_room
    takes = _by_handle(places["peg_grasp"], places["peg_tip"], 0.0, _ROUGHLY, reaches)
    grasp, tip = places["target_peg_grasp"], places["target_peg_tip"]
    # In the air it may lean about the midpoint of its centre and tip, which both count.
    about = (
        0.0 if task._insert else float(np.linalg.norm(places["target_peg"] + tip - 2 * grasp)) / 2
    )
    leaning = _EXACTLY if task._insert else _LEANING
    return takes, rakes, _by_handle(grasp, tip, about, leaning, reaches)


def _by_handle(
    grasp: np.ndarray, tip: np.ndarray, about: float, tilt: float, reaches: _Reaches
) -> bool:
    """Whether a peg can be held that may lean about a point at a distance ahead of its handle."""
    along = tip - grasp
    point = grasp + about * along / np.linalg.norm(along)
    return reaches(point, GRASP + about, angle_of(along), tilt)


def _stacker(task: Any, places: _Places, reaches: _Reaches) -> tuple[bool, bool, bool]:
    """Whether enough boxes can be taken from above, whether raked, whether put at the target."""
    down = angle_of(_DOWN)

    def from_above(place: np.ndarray) -> bool:
        return reaches(place - _ABOVE * _DOWN, PINCH, down, _STEEP)

    target = places["target"]
    half = min(places[box][1] for box in task.boxes)  # of a box, which lies on the floor
    levels = round((target[1] / half - 1) / 2) + 1
    taken = [from_above(places[box]) for box in task.boxes]
    got = [
        take or _raked(places[box], reaches) for take, box in zip(taken, task.boxes, strict=True)
    ]
    return sum(taken) >= levels, sum(got) >= levels, from_above(target)


def main(
    episodes: Annotated[int, typer.Option(min=1, max=1000, help="Of seeds 0 and up.")] = 1000,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the figures.")] = None,
) -> None:
    """Print what is reachable in each of the arm's tasks."""
    results = []
    for domain, task in _TASKS:
        scores = sources.RESULTS / "scores" / f"{domain}-{task}-zero.json"
        played = json.loads(scores.read_text(encoding="utf-8"))["episodes"]
        returns = [episode["return"] for episode in played[:episodes]]
        result = measure(domain, task, episodes, returns)
        typer.echo(
            f"{domain}:{task}: taken {result['taken']:.1%}, raked {result['raked']:.1%}, "
            f"brought {result['brought']:.1%}, cap {result['cap']:.0f}"
        )
        results.append(result)
    if json_file is not None:
        sources.write(json_file, results)


if __name__ == "__main__":
    typer.run(main)
