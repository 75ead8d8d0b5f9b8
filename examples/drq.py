"""Learning from pictures: DrQ-v2 on the rows of a batch, in one process on the CPU.

    pip install fsspec pyarrow torch
    python examples/drq.py --steps 200000 --envs 4 --out drq

It observes the last three pictures of 64 by 64 pixels, and nothing else. They have the quality
"fast": no shadows, no reflections and no sky. The recipe is that of Yarats et al., "Mastering
Visual Continuous Control" (2021), with smaller networks: random shifts of the pictures, rewards of
three actions, two critics, and noise of exploration that falls with time. `curve.csv` in DIR has a
line for each evaluation. After a kill the same command continues from the last evaluation, with the
same result, and so does one with more --steps. A folder of a run with other options is refused.
"""

import argparse
import csv
import dataclasses
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]
from torch.nn import functional  # pyright: ignore[reportMissingImports]

from limberjack import gym

_SIDE = 64  # pixels; DrQ-v2 has 84, with which an update takes twice as long
_STACK = 3  # pictures, so that velocities can be seen
_COLOURS = 3
_SHIFT = 3  # pixels at most; 4 of 84 in the paper
_CHANNELS, _FEATURES, _UNITS = 16, 50, 256  # of convolutions, of their summary, of other layers
_BATCH = 64  # transitions for an update; 256 in the paper
_EVERY = 2  # actions of a row for an update
_RATE = 3e-4  # of learning; the paper's 1e-4 is for ten times as many updates
# Weight of the actor's squared outputs before tanh. Without it, the actor of the first updates has
# one action at its limit for all pictures, where the gradient is 0.
_LEAN = 1e-3
_MIX = 0.01  # part of the critics that their targets take over with each update
_DISCOUNT = 0.98  # of an action, for the 125 actions of an episode
_REWARDS = 3  # actions whose rewards are added before the critic's estimate
_NOISE = 1.0, 0.1  # standard deviation of exploration at the beginning and at the end
_LESS = 5_000  # actions over which it falls
_CLIP = 0.3  # limit of the noise with which critics and actor are trained
_RANDOM = 500  # actions drawn at random, before the first update
_TRAINED, _HELD_OUT = 1_000_000, 40_000  # first seeds of the rows
_EPISODES = 10  # of an evaluation
_EVALUATE = 1_000  # actions between evaluations
_COLUMNS = (
    *("control_steps", "actions", "processor_seconds", "mean"),
    *(f"return_{number}" for number in range(1, _EPISODES + 1)),
)


class Encoder(nn.Module):
    """Convolutions over pictures, (n, 9, 64, 64) uint8, to one row of numbers each."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = _COLOURS * _STACK
        for stride in (2, 2, 2, 1):
            layers += [nn.Conv2d(channels, _CHANNELS, 3, stride), nn.ReLU()]
            channels = _CHANNELS
        self.layers = nn.Sequential(*layers, nn.Flatten())
        self.size = self.layers(torch.zeros(1, _COLOURS * _STACK, _SIDE, _SIDE)).shape[-1]

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Numbers, (n, size)."""
        return self.layers(pictures.float() / 255 - 0.5)


def _begin(layer: nn.Module) -> None:
    """Sets a layer's first weights, with which pictures that differ have features that differ."""
    if isinstance(layer, nn.Conv2d | nn.Linear):
        is_convolution = isinstance(layer, nn.Conv2d)
        nn.init.orthogonal_(layer.weight, nn.init.calculate_gain("relu") if is_convolution else 1)
        nn.init.zeros_(layer.bias)


def head(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers."""
    hidden = nn.Linear(inputs, _UNITS), nn.ReLU(), nn.Linear(_UNITS, _UNITS), nn.ReLU()
    return nn.Sequential(*hidden, nn.Linear(_UNITS, outputs))


def summary(inputs: int) -> nn.Sequential:
    """The layer that reduces the encoder's numbers to a few."""
    return nn.Sequential(nn.Linear(inputs, _FEATURES), nn.LayerNorm(_FEATURES), nn.Tanh())


class Critics(nn.Module):
    """Two estimates of the return of an action, (2, n)."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()
        self.summary = summary(inputs)
        self.heads = nn.ModuleList(head(_FEATURES + actions, 1) for _ in range(2))

    def forward(self, encoded: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """The estimates."""
        both = torch.cat([self.summary(encoded), actions], -1)
        return torch.stack([each(both)[..., 0] for each in self.heads])


class Agent(nn.Module):
    """Encoder, actor and critics; actions lie between -1 and 1."""

    def __init__(self, actions: int) -> None:
        super().__init__()
        self.encoder = Encoder()
        size = self.encoder.size
        self.actor = nn.Sequential(summary(size), head(_FEATURES, actions))
        self.critics, self.targets = Critics(size, actions), Critics(size, actions)
        self.apply(_begin)
        # In this order of memory, convolutions take half the time on a processor.
        self.encoder.to(memory_format=torch.channels_last)
        self.targets.load_state_dict(self.critics.state_dict())
        seen = [*self.encoder.parameters(), *self.critics.parameters()]
        self.of_critics = torch.optim.Adam(seen, _RATE)
        self.of_actor = torch.optim.Adam(self.actor.parameters(), _RATE)

    @torch.no_grad()
    def act(self, pictures: np.ndarray, noise: float = 0.0) -> np.ndarray:
        """Actions for stacked pictures, (n, 64, 64, 9)."""
        seen = torch.from_numpy(pictures).movedim(-1, -3)
        mean = self.actor(self.encoder(seen)).tanh()
        return (mean + noise * torch.randn_like(mean)).clamp(-1, 1).numpy()

    def update(self, batch: "Transitions", noise: float) -> None:
        """One step of both optimisers."""
        with torch.no_grad():
            following = self.encoder(shifted(batch.following))
            best = self.targets(following, _near(self.actor(following), noise)).amin(0)
            goal = batch.rewards + batch.discounts * best
        encoded = self.encoder(shifted(batch.pictures))
        loss = ((self.critics(encoded, batch.actions) - goal) ** 2).mean(-1).sum()
        self.of_critics.zero_grad(set_to_none=True)
        loss.backward()
        self.of_critics.step()

        encoded = encoded.detach()
        chosen = self.actor(encoded)
        loss = _LEAN * (chosen**2).mean()
        loss = loss - self.critics(encoded, _near(chosen, noise)).amin(0).mean()
        self.of_actor.zero_grad(set_to_none=True)
        loss.backward()
        self.of_actor.step()
        with torch.no_grad():
            pairs = zip(self.targets.parameters(), self.critics.parameters(), strict=True)
            for target, learned in pairs:
                target.lerp_(learned, _MIX)


def _near(chosen: torch.Tensor, noise: float) -> torch.Tensor:
    """The actor's actions with noise; the gradient is that of the actions without noise."""
    mean = chosen.tanh()
    moved = mean + (noise * torch.randn_like(mean)).clamp(-_CLIP, _CLIP)
    return mean + (moved.clamp(-1, 1) - mean).detach()


def shifted(pictures: torch.Tensor) -> torch.Tensor:
    """Pictures, each moved by a few pixels in a random direction; edges are repeated."""
    padded = functional.pad(pictures.float(), (_SHIFT,) * 4, mode="replicate").to(torch.uint8)
    count = len(pictures)
    first = torch.randint(2 * _SHIFT + 1, (2, count, 1))
    rows, columns = first + torch.arange(_SIDE)
    index = torch.arange(count)[:, None, None]
    # The channels come last when three arrays of numbers are given beside a slice.
    return padded[index, :, rows[:, :, None], columns[:, None, :]].movedim(-1, 1)


@dataclasses.dataclass(frozen=True)
class Transitions:
    """Stacked pictures, actions, sums of discounted rewards, and pictures some actions later."""

    pictures: torch.Tensor
    actions: torch.Tensor
    rewards: torch.Tensor
    discounts: torch.Tensor  # of the value of the later pictures; 0 where the task has ended
    following: torch.Tensor


class Replay:
    """All actions of all rows, in files, with the picture before each.

    A file is as large as the run, but takes space only for what was written. A continued run writes
    again what came after its checkpoint.
    """

    def __init__(self, directory: Path, steps: int, rows: int, actions: int) -> None:
        def array(name: str, dtype: str, *shape: int) -> np.memmap:
            file = directory / f"{name}.replay"
            mode = "r+" if file.exists() else "w+"
            return np.memmap(file, dtype, mode, shape=(steps, rows, *shape))

        self._pictures = array("pictures", "u1", _COLOURS, _SIDE, _SIDE)
        self._actions = array("actions", "f4", actions)
        self._rewards = array("rewards", "f4")
        self._goes_on = array("goes_on", "f4")  # 0 if the task ends with this action
        self._age = array("age", "i4")  # actions since the beginning of the episode
        self._is_last = array("is_last", "?")  # no action follows the picture

    def write(self, step: int, **values: np.ndarray) -> None:
        """Keeps a step of all rows."""
        pictures = values["pictures"][..., -_COLOURS:]
        self._pictures[step] = np.moveaxis(pictures, -1, -3)
        for name in ("actions", "rewards", "goes_on", "age", "is_last"):
            getattr(self, f"_{name}")[step] = values[name]

    def draw(self, steps: int, count: int) -> Transitions:
        """Transitions among the first steps, drawn with equal probability."""
        rows = self._rewards.shape[1]
        at, row = np.empty(0, int), np.empty(0, int)
        while len(at) < count:  # the last picture of an episode begins none
            drawn = torch.randint((steps - _REWARDS) * rows, (count,)).numpy()
            drawn = drawn[~self._is_last.reshape(-1)[drawn]]
            at, row = np.append(at, drawn // rows)[:count], np.append(row, drawn % rows)[:count]
        rewards, discounts, later = np.zeros(count, "f4"), np.ones(count, "f4"), at.copy()
        for _ in range(_REWARDS):
            runs = ~self._is_last[later, row]
            rewards += np.where(runs, discounts * self._rewards[later, row], 0)
            discounts *= np.where(runs, _DISCOUNT * self._goes_on[later, row], 1)
            later += runs
        return Transitions(
            self._stacked(at, row),
            torch.from_numpy(self._actions[at, row]),
            torch.from_numpy(rewards),
            torch.from_numpy(discounts),
            self._stacked(later, row),
        )

    def _stacked(self, at: np.ndarray, row: np.ndarray) -> torch.Tensor:
        """The pictures before actions with those before them, (n, 9, 64, 64)."""
        age = self._age[at, row]
        backs = [np.minimum(back, age) for back in range(_STACK - 1, -1, -1)]
        return torch.from_numpy(np.concatenate([self._pictures[at - b, row] for b in backs], 1))


class Run:
    """Rows, agent, replay and curve of one run, which a folder keeps."""

    def __init__(self, given: argparse.Namespace) -> None:
        self._given = given
        self._out = Path(given.out)
        self._out.mkdir(parents=True, exist_ok=True)
        self._checkpoint = self._out / "checkpoint.pt"
        saved = self._saved()
        torch.manual_seed(given.seed)
        self._envs, self._held_out = self._rows(given.envs), self._rows(_EPISODES)
        self._actions = self._envs.single_action_space.shape[0]
        self._agent = Agent(self._actions)
        self._total = max(1, given.steps // (given.envs * given.action_repeat))
        self._replay = Replay(self._out, self._total, given.envs, self._actions)
        self._curve: list[list[float]] = []
        self._step, self._seconds = 0, 0.0
        self._pictures = self._envs.reset(seed=_TRAINED + 1000 * given.seed)[0]
        self._age = np.zeros(given.envs, int)
        self._is_last = np.zeros(given.envs, bool)
        if saved is not None:
            self._restore(saved)

    # Any: Gymnasium's types do not say that observations are arrays and actions have bounds.
    def _rows(self, count: int) -> Any:
        domain, _, task = self._given.task.partition(":")
        return gym.load_vector(
            *(domain, task, count),
            action_repeat=self._given.action_repeat,
            time_limit=self._given.seconds,
            pixels={
                "camera": self._given.camera,
                "height": _SIDE,
                "width": _SIDE,
                "only": True,
                "frame_stack": _STACK,
                "quality": "fast",
            },
        )

    def learn(self) -> None:
        """Acts and learns until all steps are taken, with evaluations on the way."""
        every = max(1, self._given.evaluate_every // self._given.envs)
        began = time.process_time() - self._seconds
        while self._step < self._total:
            if self._step % every == 0:
                self._seconds = time.process_time() - began
                self._evaluate()
                began = time.process_time() - self._seconds
            self._act()
            taken = self._step * self._given.envs
            is_filled = taken >= self._given.random and self._step > _REWARDS
            due = taken // _EVERY - (taken - self._given.envs) // _EVERY
            for _ in range(due if is_filled else 0):
                self._agent.update(self._replay.draw(self._step, _BATCH), self._noise())
        self._seconds = time.process_time() - began
        self._evaluate()

    def _noise(self) -> float:
        first, last = _NOISE
        return first + (last - first) * min(self._step * self._given.envs / _LESS, 1.0)

    def _scaled(self, actions: np.ndarray) -> np.ndarray:
        """Actions of the task for those of the agent, which lie between -1 and 1."""
        space = self._envs.single_action_space
        return space.low + (actions + 1) / 2 * (space.high - space.low)

    def _act(self) -> None:
        """A step of all rows, which the replay keeps."""
        if self._step * self._given.envs < self._given.random:
            shape = self._given.envs, self._actions
            actions = (2 * torch.rand(shape) - 1).numpy()
        else:
            actions = self._agent.act(self._pictures, self._noise())
        scaled = self._scaled(actions)
        observations, rewards, terminated, truncated, _ = self._envs.step(scaled)
        self._replay.write(
            self._step,
            pictures=self._pictures,
            actions=actions,
            rewards=rewards / self._given.action_repeat,  # so that values are at most 50
            goes_on=~terminated,
            age=self._age,
            is_last=self._is_last,
        )
        # The step of a row after its last one only begins its next episode.
        self._age = np.where(self._is_last, 0, self._age + 1)
        self._is_last = terminated | truncated
        self._pictures = observations
        self._step += 1

    def _evaluate(self) -> None:
        """Plays episodes without noise, adds their returns to the curve, and saves everything."""
        if self._curve and self._curve[-1][1] == self._step * self._given.envs:
            return
        pictures = self._held_out.reset(seed=_HELD_OUT)[0]
        returns, runs = np.zeros(_EPISODES), np.ones(_EPISODES, bool)
        while runs.any():
            actions = self._scaled(self._agent.act(pictures))
            observations, rewards, terminated, truncated, _ = self._held_out.step(actions)
            returns += np.where(runs, rewards, 0)
            runs &= ~(terminated | truncated)
            pictures = observations
        taken = self._step * self._given.envs
        steps = taken * self._given.action_repeat
        self._curve.append([steps, taken, round(self._seconds, 1), returns.mean(), *returns])
        print(f"{steps} control steps, {self._seconds:.0f} s: return {returns.mean():.1f}")
        self._save()

    def _save(self) -> None:
        names = ("_envs", "_curve", "_step", "_seconds", "_pictures", "_age", "_is_last")
        state = {name: getattr(self, name) for name in names}
        parts = self._agent, self._agent.of_critics, self._agent.of_actor
        state |= {"agent": [part.state_dict() for part in parts], "random": torch.get_rng_state()}
        state["options"] = self._options()
        # First, since a run that continues writes it with its next evaluation only.
        with (self._out / "curve.csv").open("w", newline="") as file:
            csv.writer(file).writerows([_COLUMNS, *self._curve])
        new = self._checkpoint.with_suffix(".new")
        torch.save(state, new)
        os.replace(new, self._checkpoint)

    def _options(self) -> dict[str, object]:
        """The options that a run which continues must have."""
        given = vars(self._given)
        return {name: given[name] for name in given if name not in ("steps", "out")}

    def _saved(self) -> dict[str, Any] | None:
        """The last checkpoint; None without one. Ends the program if that is of another run."""
        if not self._checkpoint.exists():
            return None
        # The file has the rows themselves, so that it is a pickle: continue your own runs only.
        state = torch.load(self._checkpoint, weights_only=False)
        there = state.pop("options", {})
        for name, here in self._options().items():
            if there.get(name) != here:
                raise SystemExit(
                    f"{self._out} has a run with {name} {there.get(name)!r}, not {here!r}: choose "
                    "another folder"
                )
        return state

    def _restore(self, state: dict[str, Any]) -> None:
        torch.set_rng_state(state.pop("random"))
        parts = self._agent, self._agent.of_critics, self._agent.of_actor
        for part, values in zip(parts, state.pop("agent"), strict=True):
            part.load_state_dict(values)
        self._envs.close()
        vars(self).update(state)


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200_000, help="control steps of all rows")
    parser.add_argument("--envs", type=int, default=4, help="rows of the batch")
    parser.add_argument("--task", default="cartpole:balance", help="such as reacher:easy")
    parser.add_argument("--camera", type=int, default=0, help="number of the task's camera")
    parser.add_argument("--action-repeat", type=int, default=8, help="control steps per action")
    parser.add_argument("--seconds", type=float, help="length of an episode; the task's by default")
    parser.add_argument("--seed", type=int, default=0, help="of the networks and the rows")
    parser.add_argument("--random", type=int, default=_RANDOM, help="actions before learning")
    parser.add_argument("--evaluate-every", type=int, default=_EVALUATE, help="actions")
    parser.add_argument("--out", default="drq", help="folder of the run")
    torch.set_num_threads(1)  # the networks are small, and the rows need the other cores
    Run(parser.parse_args()).learn()


if __name__ == "__main__":
    main()
