"""Learning curves of three easy tasks: Stable-Baselines3's PPO on a batch, three seeds each.

    pip install stable-baselines3 matplotlib
    python benchmarks/learning_curves.py [--only TASK]... [--steps N]

It writes `results/learning_curves.json`, with the mean return of the latest 100 training episodes
over steps, and draws `docs/images/learning_curves.svg` from it. The settings are the same for all
tasks: a beginning, not the best that PPO can do. Seeds run side by side, one process for each core.
"""

import concurrent.futures
import importlib
import importlib.metadata
import json
import multiprocessing
import statistics
import time
from pathlib import Path
from typing import Annotated, Any

import typer

import limberjack
from limberjack import sb3
from limberjack.utils.cores import usable_cores

__all__ = ["main"]

_RESULTS = Path(__file__).parent / "results" / "learning_curves.json"
_PICTURE = Path(__file__).parents[1] / "docs" / "images" / "learning_curves.svg"
_STEPS = {"cartpole:swingup": 500_000, "reacher:easy": 500_000, "cheetah:run": 1_000_000}
_SEEDS = (0, 1, 2)
_ENVS = 64
_ROLLOUT = 64  # steps of each row between two updates
_SETTINGS: dict[str, Any] = {
    "n_steps": _ROLLOUT,
    "batch_size": 256,
    "n_epochs": 10,
    "gamma": 0.99,
    "learning_rate": 3e-4,
}
_PACKAGES = ("stable-baselines3", "torch", "mujoco")


def _train(name: str, seed: int, steps: int) -> dict[str, Any]:
    """One run: its curve, and the seconds that it took."""
    torch: Any = importlib.import_module("torch")
    learning: Any = importlib.import_module("stable_baselines3")
    vectors: Any = importlib.import_module("stable_baselines3.common.vec_env")
    callbacks: Any = importlib.import_module("stable_baselines3.common.callbacks")
    torch.set_num_threads(1)  # the networks are small: more threads cost more than they bring
    domain, task = name.split(":")
    batch: Any = sb3.make_vec_env(domain, task, _ENVS, seed=1_000 * seed, num_threads=1)
    envs = vectors.VecNormalize(vectors.VecMonitor(batch), gamma=_SETTINGS["gamma"])
    curve: list[tuple[int, float]] = []

    class Curve(callbacks.BaseCallback):  # pyright: ignore[reportUntypedBaseClass]
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            latest = [episode["r"] for episode in self.model.ep_info_buffer]
            if latest:
                curve.append((self.num_timesteps, round(statistics.fmean(latest), 2)))

    model = learning.PPO("MlpPolicy", envs, seed=seed, device="cpu", **_SETTINGS)
    start = time.perf_counter()
    model.learn(steps, callback=Curve())
    envs.close()
    return {"seed": seed, "seconds": round(time.perf_counter() - start), "curve": curve}


def _draw(results: dict[str, Any]) -> None:
    pyplot: Any = importlib.import_module("matplotlib.pyplot")
    pyplot.rcParams.update({"svg.hashsalt": "limberjack", "font.size": 9})
    figure, axes = pyplot.subplots(
        1, len(results["runs"]), figsize=(9, 2.8), sharey=True, squeeze=False
    )
    for axis, (name, runs) in zip(axes[0], results["runs"].items(), strict=True):
        for run in runs:
            steps, returns = zip(*run["curve"], strict=True)
            axis.plot([n / 1e6 for n in steps], returns, linewidth=1, label=f"seed {run['seed']}")
        axis.set(title=name.replace(":", " "), xlabel="million steps", ylim=(0, 1000))
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("return of training episodes")
    axes[0, 0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(_PICTURE, metadata={"Date": None})


def main(
    only: Annotated[list[str] | None, typer.Option(help="Train on this DOMAIN:TASK only.")] = None,
    steps: Annotated[int | None, typer.Option(help="Steps of each run; shorter to try it.")] = None,
) -> None:
    """Train on each task with each seed, and draw the curves."""
    results: dict[str, Any] = {"settings": {**_SETTINGS, "envs": _ENVS}, "runs": {}}
    if _RESULTS.exists():
        results["runs"] = json.loads(_RESULTS.read_text(encoding="utf-8"))["runs"]
    results["versions"] = {"limberjack": limberjack.__version__}
    results["versions"] |= {name: importlib.metadata.version(name) for name in _PACKAGES}
    names = only or list(_STEPS)
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(usable_cores(), context) as pool:
        waiting = {
            name: [pool.submit(_train, name, seed, steps or _STEPS[name]) for seed in _SEEDS]
            for name in names
        }
        for name, runs in waiting.items():
            results["runs"][name] = [run.result() for run in runs]
            final = [run["curve"][-1][1] for run in results["runs"][name]]
            typer.echo(f"{name}: last returns {final}")
    results["runs"] = {name: results["runs"][name] for name in _STEPS if name in results["runs"]}
    _RESULTS.write_text(json.dumps(results) + "\n", encoding="utf-8")
    _draw(results)


if __name__ == "__main__":
    typer.run(main)
