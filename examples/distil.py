"""A first try: a network learns to bring a ball from the planner, which sees the simulator.

    pip install sbx-rl stable-baselines3 tensorboard torch
    pip install fsspec pyarrow
    python examples/distil.py --steps 600000 --out distilled

It collects 40 episodes of the planner, half a minute of one core each. Then it trains: half of each
batch is demonstrations, and most episodes begin at a moment of one, so that the hand is often near
the ball, and the ball near its target, long before the network knows the way there. At the end it
plays the task itself, with its own starts, on seeds that neither has seen, and leaves
distilled/policy.safetensors, which `limberjack view manipulator bring_ball --policy
mlp:distilled/policy.safetensors` plays. A call that was killed continues. docs/training.md has what
it reached: it brings the ball once the hand is near, and does not find the way there.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

from limberjack import data, suite
from limberjack.evaluation import evaluate
from limberjack.policies import mlp
from limberjack.rl import control
from limberjack.suite import manipulator
from limberjack.training import Settings, train

_TASK = "manipulator", "bring_ball"
_SHOWN = range(30_000, 30_040)  # seeds of the demonstrations; those of the scores begin at 0
_SHARE = 0.7  # of the episodes, which begin at a moment of a demonstration
_UNTIL = 0.6  # of a demonstration: then it only holds the ball
_SECONDS = 4.0  # of an episode in training: more starts in the same time
_SHOWN_EVERY = 10_000  # control steps
_FOUND = 300.0  # return of a demonstration that shows the way

# The networks are those of tasks with as many joints. A small weight of the entropy keeps what the
# demonstrations show, and rewards of three actions tell of the target sooner.
_SETTINGS = Settings(
    steps=600_000,
    updates=1.0,
    batch_size=256,
    actor=(256, 256),
    critic=(256, 256),
    entropy=0.01,
    n_steps=3,
)


class _Moments(NamedTuple):
    """The states in E demonstrations of T steps, and where their targets are.

    Attributes:
      qpos, qvel: (E, T, nq) and (E, T, nv).
      fields: the model fields that were drawn for each, (E, ...).
    """

    qpos: np.ndarray
    qvel: np.ndarray
    fields: dict[str, np.ndarray]


class _FromDemonstrations(manipulator.Bring):
    """Bring the ball, from moments of demonstrations in most episodes."""

    moments: _Moments

    def initialize_episode(self, physics: manipulator.Physics) -> None:
        """Draws a start of the task, or a moment."""
        super().initialize_episode(physics)
        if self.random.uniform() > _SHARE:
            return
        qpos, qvel, fields = self.moments
        shown, steps, _ = qpos.shape
        one, moment = self.random.randint(shown), self.random.randint(int(_UNTIL * steps))
        physics.data.qpos[:], physics.data.qvel[:] = qpos[one, moment], qvel[one, moment]
        for name, drawn in fields.items():
            getattr(physics.model, name)[:] = drawn[one]
        physics.after_reset()


def make(seed: int) -> control.Environment:
    """The environment in which the network is trained."""
    plain = suite.load(*_TASK)
    task = _FromDemonstrations(use_peg=False, insert=False, fully_observable=True, random=seed)
    interval = plain.control_timestep()
    return control.Environment(plain.physics, task, _SECONDS, control_timestep=interval)


def _moments_of(dataset: data.Dataset) -> _Moments:
    """The moments of the demonstrations that reach the target."""
    episodes = [episode for episode in dataset if episode.total > _FOUND]
    model = suite.load(*_TASK).physics.model
    time_qpos_qvel = np.array([episode.states for episode in episodes])  # the first of a state
    fields = {name: np.array([of.fields[name] for of in episodes]) for name in episodes[0].fields}
    qpos, qvel = np.split(time_qpos_qvel[..., 1 : 1 + model.nq + model.nv], [model.nq], axis=-1)
    return _Moments(qpos, qvel, fields)


def _show(done: int, steps: int, mean: float) -> None:
    if done % _SHOWN_EVERY == 0:
        print(f"{done:,} of {steps:,} control steps, {mean:.0f} in the last evaluation", flush=True)


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("distilled"), help="folder of all files")
    parser.add_argument("--steps", type=int, default=_SETTINGS.steps, help="control steps")
    parser.add_argument("--shown", type=int, default=len(_SHOWN), help="demonstrations")
    parser.add_argument("--seed", type=int, default=0, help="of the networks and the starts")
    parser.add_argument("--episodes", type=int, default=100, help="that score the network")
    given = parser.parse_args()

    shown, kept = given.out / "demonstrations", data.Kept(states=True)
    data.collect(*_TASK, "planner", _SHOWN[: given.shown], out=shown, kept=kept, workers=2)
    dataset = data.load(shown)
    _FromDemonstrations.moments = _moments_of(dataset)
    run = train(
        make,
        out=given.out / "training",
        steps=given.steps,
        seed=given.seed,
        settings=_SETTINGS,
        demonstrations=dataset,
        on_progress=_show,
        command=f"python examples/distil.py --steps {given.steps} --shown {given.shown} "
        f"--seed {given.seed}",
    )
    learned, out = mlp.load(run.policy), given.out / "policy.safetensors"
    card = dataclasses.replace(learned.card, domain=_TASK[0], task=_TASK[1])
    mlp.save(out, learned.layers, card)
    found = evaluate(*_TASK, f"mlp:{out}", range(given.episodes))
    print(f"return of the demonstrations {np.mean([episode.total for episode in dataset]):.1f}")
    print(f"return of the network {found.summary(found.policy).mean:.1f}: {out}")


if __name__ == "__main__":
    main()
