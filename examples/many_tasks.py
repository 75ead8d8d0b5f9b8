"""Many tasks in one batch: random actions, and the statistics of each task.

    python examples/many_tasks.py --steps 1000             # the 28 tasks that papers report
    python examples/many_tasks.py --tasks walker:walk,fish:swim --rows 4
    python examples/many_tasks.py --tasks mt30 --files tdmpc2/tdmpc2/envs/tasks

It needs nothing but Limberjack. `--files` imports the Python files of a folder before, under the
names of dm_control: such files add tasks of their own to the domains of the suite. Those of TD-MPC2
add the eleven tasks of `mt30` that the suite lacks. A task whose code cannot take all rows at once
is played in complete environments; the reason is printed.
"""

import argparse
import importlib.util
import time
from pathlib import Path

import numpy as np

import limberjack
from limberjack import gym


def import_files(folder: Path) -> None:
    """Imports the Python files of a folder, in which dm_control is Limberjack."""
    limberjack.install_as_dm_control()
    paths = [path for path in sorted(folder.glob("*.py")) if path.stem != "__init__"]
    if not paths:
        raise SystemExit(f"{folder} has no Python files; expected those that define tasks")
    for path in paths:
        spec = importlib.util.spec_from_file_location(f"tasks_of_{path.stem}", path)
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


def main() -> None:
    """Runs the example."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", default="dmc28", help="a set, or tasks with commas between them")
    parser.add_argument("--rows", type=int, default=8, help="rows of each task")
    parser.add_argument("--steps", type=int, default=1000, help="steps of each row")
    parser.add_argument("--files", type=Path, help="folder of files that define more tasks")
    given = parser.parse_args()

    if given.files is not None:
        import_files(given.files)
    envs = gym.load_vector(given.tasks, rows=given.rows, autoreset_mode="SameStep")
    assert isinstance(envs, gym.ManyVectorEnv)
    for batch in envs.batches[0].parts:
        if batch.why_rows is not None:
            print(f"{batch.name} is played in complete environments: {batch.why_rows}")

    generator = np.random.default_rng(0)
    envs.reset(seed=0)
    began = time.perf_counter()
    for _ in range(given.steps):
        # A policy gets the observations and `envs.task_ids`, and its actions are masked likewise.
        envs.step(generator.uniform(-1, 1, envs.action_space.shape) * envs.action_mask)
    seconds = time.perf_counter() - began
    for name, task in envs.statistics().items():
        print(f"{name:28} {task.episodes:4} episodes, mean return {task.mean_return:7.2f}")
    count = given.steps * envs.num_envs
    print(f"{len(envs.tasks)} tasks: {count} steps, {count / seconds:.0f} a second")
    envs.close()


if __name__ == "__main__":
    main()
