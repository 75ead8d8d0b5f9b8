"""How many starts of the arm's tasks let the hand take what it must, and bring it where it must.

    python benchmarks/reach.py [--episodes 1000] [--json FILE]

Each episode's objects fall for two seconds while nothing is done. Where they lie then, inverse
kinematics looks for joints of the arm that have its fingers around the object, and for joints that
have the object at the target in the same grip; joints' limits, floor and walls count, other objects
do not. A start without both is out of reach. It may be won all the same, by an arm that catches the
object as it falls or rakes it out of its corner, so `cap` is no law: it is what taking and bringing
alone can reach, 1,000 for each start within reach and the return of doing nothing for others.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from limberjack import suite
from limberjack.planner.planar_ik import PINCH, angle_of, hand_poses

__all__ = ["main", "measure"]

_TASKS = [task for task in suite.ALL_TASKS if task[0] in ("manipulator", "stacker")]
_FALL = 200  # control steps of 10 ms
_FULL = 1_000.0
_TRIES = 16  # poses that are looked for
_FREE = np.pi  # any angle of the hand
_ROUGHLY, _EXACTLY = 0.3, 0.1  # radians between the hand and the object, before and after
_DOWN, _STEEP = np.array([0.0, -1.0]), 0.5
_ABOVE = 0.045  # metres; how far above a box's centre the fingertips' site is when it is held
_PLANE = [0, 2]

_Places = dict[str, np.ndarray]  # of the sites, (2,) each
_Reaches = Callable[..., bool]


def measure(domain: str, task: str, episodes: int, zero_returns: Sequence[float]) -> dict[str, Any]:
    """What can be reached in the episodes of seeds 0 and up.

    Args:
      domain: of the task.
      task: its name.
      episodes: how many.
      zero_returns: of doing nothing, for each seed.
    """
    batch = suite.load_batch(domain, task, episodes, seed=0)
    batch.reset()
    still = np.zeros(batch.action_spec().shape)
    for _ in range(_FALL):
        batch.step(still)
    sites = batch.physics.named.data.site_xpos
    names = sites.axes.row.names
    places = sites[names][..., _PLANE]
    random = np.random.default_rng(0)
    within = _stacker if domain == "stacker" else _manipulator
    found = np.array(
        [within(batch.task, dict(zip(names, row, strict=True)), _reaches(random)) for row in places]
    )
    batch.close()
    takes, brings = found.T
    best = np.where(takes & brings, _FULL, zero_returns)
    return {
        "domain": domain,
        "task": task,
        "episodes": episodes,
        "object_within_reach": float(takes.mean()),
        "target_within_reach": float(brings.mean()),
        "both": float((takes & brings).mean()),
        "cap": float(best.mean()),
    }


def _reaches(random: np.random.Generator) -> _Reaches:
    """Whether the fingertips can be at a point, with the hand at an angle, give or take a tilt."""

    def reaches(point: np.ndarray, angle: float | None, tilt: float) -> bool:
        return len(hand_poses(random, point, PINCH, np.zeros(4), _TRIES, angle, tilt)) > 0

    return reaches


def _manipulator(task: Any, places: _Places, reaches: _Reaches) -> tuple[bool, bool]:
    """Whether the object can be taken, and be brought in one of the grips that can take it."""
    if not task._use_peg:
        target = places["target_ball"]
        return reaches(places["ball"], None, _FREE), reaches(target, None, _FREE)
    grips = [("peg_grasp", "peg_tip")]
    if not task._insert:  # the tip must be free to go in
        grips.append(("peg_tip", "peg_grasp"))
    taken = [grip for grip in grips if _along(places, grip, "", _ROUGHLY, reaches)]
    brought = [g for g in taken or grips if _along(places, g, "target_", _EXACTLY, reaches)]
    return bool(taken), bool(brought)


def _along(
    places: _Places, grip: tuple[str, str], prefix: str, tilt: float, reaches: _Reaches
) -> bool:
    at, ahead = (places[prefix + name] for name in grip)
    return reaches(at, angle_of(ahead - at), tilt)


def _stacker(task: Any, places: _Places, reaches: _Reaches) -> tuple[bool, bool]:
    """Whether enough boxes can be taken from above, and put at the target."""
    down = angle_of(_DOWN)

    def from_above(place: np.ndarray) -> bool:
        return reaches(place - _ABOVE * _DOWN, down, _STEEP)

    target = places["target"]
    half = min(places[box][1] for box in task._boxes)  # of a box, which lies on the floor
    levels = round((target[1] / half - 1) / 2) + 1
    return sum(from_above(places[box]) for box in task._boxes) >= levels, from_above(target)


def main(
    episodes: Annotated[int, typer.Option(min=1, max=1000, help="Of seeds 0 and up.")] = 1000,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the figures.")] = None,
) -> None:
    """Print what is within reach in each of the arm's tasks."""
    results = []
    for domain, task in _TASKS:
        scores = Path(__file__).parent / "results" / "scores" / f"{domain}-{task}-zero.json"
        played = json.loads(scores.read_text(encoding="utf-8"))["episodes"]
        returns = [episode["return"] for episode in played[:episodes]]
        result = measure(domain, task, episodes, returns)
        typer.echo(
            f"{domain}:{task}: object {result['object_within_reach']:.1%}, target "
            f"{result['target_within_reach']:.1%}, both {result['both']:.1%}, "
            f"cap {result['cap']:.0f}"
        )
        results.append(result)
    if json_file is not None:
        json_file.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
