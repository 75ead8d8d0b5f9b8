"""Each example runs for a little while and says what it should."""

import importlib
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import from_datasets
import numpy as np
import pytest

import limberjack
from limberjack import data, policies
from limberjack.evaluation import evaluate
from limberjack.policies import mlp
from limberjack.utils.requirements import install_command
from tests.policies.network_files import write

_EXAMPLES = Path(__file__).parents[2] / "examples"
_SOURCE = Path(limberjack.__file__).parents[1]
_LIMIT = 300  # seconds; Ray takes half a minute to start on a busy machine

# By name: the packages it needs, the extra that brings them, and what it is asked to do.
_NEEDS = {
    "batch": ((), ""),
    "evolution": ((), ""),
    "gymnasium_vector": ((), ""),
    "many_tasks": ((), ""),
    "planner_cost": ((), ""),
    "policy_gymnasium": ((), ""),
    "policy_sb3": (("stable_baselines3",), "sb3"),
    "planner_picture": ((), ""),
    "behaviour_cloning": (("pyarrow", "torch"), "torch"),
    "dataset_pytorch": (("pyarrow", "torch"), "torch"),
    "distil": (("pyarrow", "sbx"), "train"),
    "offline_iql": (("pyarrow", "torch", "torchrl"), "torchrl"),
    "drq": (("pyarrow", "torch"), "torch"),
    "sb3_crossq": (("sb3_contrib", "stable_baselines3"), "sb3"),
    "torchrl_collect": (("torchrl",), "torchrl"),
    "rsl_rl_ppo": (("mujoco_warp", "torch", "rsl_rl"), "rsl-rl"),
    "unilab_flash_sac": (("mujoco_warp", "torch", "uni_rl"), "unilab-rl"),
    "rllib_ppo": (("ray", "torch"), "rllib"),
}


def _output(name: str, *arguments: str) -> str:
    """The output of an example in its own process; skips if the example's extra is missing."""
    packages, extra = _NEEDS[name]
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        pytest.skip(f"needs the extra {extra!r}: {', '.join(missing)} not installed")
    return _printed(str(_EXAMPLES / f"{name}.py"), *arguments)


def _printed(*arguments: str) -> str:
    """The output of Python with these arguments, which finds the examples as modules."""
    done = _run(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _run(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """The result of Python with these arguments."""
    path = [str(_SOURCE), str(_EXAMPLES), os.environ.get("PYTHONPATH")]
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        # One thread each for what is beneath PyTorch, on machines with other work.
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, path)),
            "OMP_NUM_THREADS": "1",
        },
        timeout=_LIMIT,
        check=False,
    )


def test_every_example_is_here_and_says_how_to_run_it() -> None:
    assert {path.stem for path in _EXAMPLES.glob("*.py")} == set(_NEEDS)
    for name, (_, extra) in _NEEDS.items():
        text = (_EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
        assert f"    python examples/{name}.py --steps " in text
        assert not extra or f"    {install_command(extra)}\n" in text


# A file as dm_control's users write them, with a task that cannot take all rows at once.
_FILE = """
from dm_control.rl import control
from dm_control.suite import pendulum

@pendulum.SUITE.add("custom")
def slow(time_limit=0.1, random=None, environment_kwargs=None):
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    return control.Environment(physics, Slow(random=random), time_limit, **environment_kwargs or {})

class Slow(pendulum.SwingUp):
    def get_reward(self, physics):
        return 1.0 if abs(float(physics.angular_velocity()[0])) < 1 else 0.0
"""


def test_many_tasks(tmp_path: Path) -> None:
    (tmp_path / "pendulum.py").write_text(_FILE)
    tasks = "pendulum:slow,reacher:easy"
    given = ["--tasks", tasks, "--rows", "2", "--steps", "12", "--files", str(tmp_path)]
    printed = _output("many_tasks", *given)
    assert "pendulum:slow is played in complete environments: the reward of task Slow" in printed
    assert re.search(
        r"^pendulum:slow +4 episodes, mean return +[0-5]\.\d\d$", printed, re.MULTILINE
    )
    assert re.search(r"^2 tasks: 48 steps, \d+ a second$", printed, re.MULTILINE)


def test_batch() -> None:
    printed = _output("batch", "--steps", "400", "--envs", "4")
    assert re.search(r"^400 steps, \d+ a second, mean reward 0\.\d+$", printed, re.MULTILINE)
    assert re.search(r"^highest head after 4 actions: \d\.\d+ m, row [0-3]$", printed, re.MULTILINE)


def test_evolution(tmp_path: Path) -> None:
    given = ["--task", "lqr_2_1", "--steps", "128000", "--envs", "64", "--out", str(tmp_path)]
    printed = _output("evolution", *given)
    returns = [float(one) for one in re.findall(r"return (\d+\.\d\d)$", printed, re.MULTILINE)]
    assert returns[-1] > returns[0]  # with weights of 0
    card = mlp.load(tmp_path / "policy.safetensors").card
    assert (card.title, card.steps, card.seeds) == ("lqr lqr_2_1", 128_000, (0,))
    assert card.command.endswith(" --task lqr_2_1 --steps 128000 --envs 64 --seed 0")
    first, *lines = (tmp_path / "curve.csv").read_text().splitlines()
    assert first.startswith("control_steps,agent_steps,processor_seconds,mean,return_1,")
    assert len(lines) == len(returns)
    where = "lqr", "lqr_2_1", f"mlp:{tmp_path / 'policy.safetensors'}"
    played = evaluate(*where, range(2_100_000_000, 2_100_000_010), time_limit=30.0)
    assert played.summary().mean == pytest.approx(returns[-1], abs=0.01)


def test_gymnasium_vector() -> None:
    printed = _output("gymnasium_vector", "--steps", "840", "--envs", "4")
    # 210 steps of each row: two episodes of 100, after each a step that only begins the next.
    assert "832 transitions, 8 episodes cut off by the time limit" in printed


def test_planner_cost() -> None:
    printed = _output("planner_cost", "--steps", "90")
    # The pole is up after 60 steps or so and stays there; without the planner it would hang.
    assert re.search(r"^return [2-6]\d\.\d of 90, at last (0\.9\d|1\.00)$", printed, re.MULTILINE)


@pytest.mark.usefixtures("pictures")
def test_planner_picture(tmp_path: Path) -> None:
    out = tmp_path / "plans.png"
    printed = _output("planner_picture", "--steps", "4", "--out", str(out))
    assert re.search(r"^\d+ plans of \d+ steps drawn in ", printed, re.MULTILINE)
    assert out.read_bytes().startswith(b"\x89PNG")


def test_dataset_pytorch() -> None:
    printed = _output("dataset_pytorch", "--steps", "100")
    assert printed.startswith("64 episodes, 6400 transitions\n")
    found = re.search(
        r"^error (\d\.\d+) at first, (\d\.\d+) after 100 steps$", printed, re.MULTILINE
    )
    assert found is not None
    assert float(found[2]) < 0.8 * float(found[1])


def _learned(name: str, policy: str, seeds: str, folder: Path) -> tuple[data.Dataset, mlp.Mlp]:
    """A small dataset of cartpole swingup, and the policy that an example learns from it."""
    _output(name, "--help")  # skips without the packages
    given = ("cartpole", "swingup", "--policy", policy, "--seeds", seeds, "--action-repeat", "4")
    _printed("-m", "limberjack", "collect", *given, "--out", str(folder / "data"))
    out = folder / "learned.safetensors"
    how = ("--steps", "400", "--data", str(folder / "data"), "--episodes", "1")
    before, _ = from_datasets.returns_in(_output(name, *how, "--out", str(out)))
    dataset, learned = data.load(folder / "data"), mlp.load(out)
    totals = [episode.total for episode in dataset]
    assert before == round(float(np.mean(totals)), 1)
    assert learned.card.action_repeat == 4
    return dataset, learned


def test_behaviour_cloning(tmp_path: Path) -> None:
    dataset, clone = _learned("behaviour_cloning", "pretrained", "0:2", tmp_path)
    for episode in dataset:
        seen = {name: values[:-1:4] for name, values in episode.observations.items()}
        error = np.sqrt(np.mean((clone.act_batch(seen) - episode.actions[::4]) ** 2))
        assert error < 0.2 * np.sqrt(np.mean(episode.actions**2))


def test_offline_iql(tmp_path: Path) -> None:
    dataset, learned = _learned("offline_iql", "offline_iql:Mixed", "0:8", tmp_path)
    totals = [episode.total for episode in dataset]
    # The shares of random actions grow from each seed to the next, and begin again with the fifth.
    assert min(totals[0], totals[4]) > 600 > 300 > max(totals[3], totals[7])
    (expert,) = (one.path for one in policies.bundled() if one.path.stem == "cartpole-swingup")
    seen = dataset[0].observations
    actions = [one.act_batch(seen).reshape(-1) for one in (learned, mlp.load(expert))]
    assert np.corrcoef(actions)[0, 1] > 0.6


def test_distil(tmp_path: Path) -> None:
    small = ("--shown", "1", "--steps", "2400", "--episodes", "1", "--out", str(tmp_path))
    for _ in range(2):  # a call on what has finished scores it again
        printed = _output("distil", *small)
        (shown,) = data.load(tmp_path / "demonstrations")
        assert shown.total > 500
        assert f"return of the demonstrations {shown.total:.1f}\n" in printed
        assert re.search(r"^return of the network \d+\.\d: ", printed, re.MULTILINE)
    card = mlp.load(tmp_path / "policy.safetensors").card
    assert (card.title, card.action_repeat) == ("manipulator bring_ball", 2)
    assert card.command == "python examples/distil.py --seed 0"
    # Most episodes begin at moments of the demonstration: with its targets.
    distil = importlib.import_module("examples.distil")
    distil._FromDemonstrations.moments = distil._moments_of(data.load(tmp_path / "demonstrations"))
    environment, places = distil.make(0), []
    for _ in range(40):
        environment.reset()
        places.append(environment.physics.named.model.body_pos["target_ball"].tolist())
    assert 20 < max(map(places.count, places)) < 36


def test_sb3_crossq(tmp_path: Path) -> None:
    out = tmp_path / "reacher.zip"
    small = ("--steps", "2400", "--envs", "4", "--seconds", "0.5", "--out", str(out))
    printed = _output("sb3_crossq", *small)
    expected = (
        r"^2400 control steps in \d+ processor seconds: return \d+\.\d \+- \d+\.\d over the seeds "
        r"40000:40100$"
    )
    assert re.search(expected, printed, re.MULTILINE)
    task, policy = ("reacher", "easy"), ("--policy", f"sb3:{out}", "--action-repeat", "2")
    played = _printed("-m", "limberjack", "run", *task, *policy, "--time-limit", "0.5")
    assert re.search(r"^ *0 +\d+\.\d{3} +25", played, re.MULTILINE), played


@pytest.mark.usefixtures("pictures")
def test_drq_learns_from_pictures_and_continues_a_run(tmp_path: Path) -> None:
    small = ("--envs", "2", "--seconds", "0.4", "--random", "12", "--evaluate-every", "20")
    curves = []
    for name, runs, evaluations in (("whole", (640,), 5), ("continued", (320, 640), 2)):
        out = tmp_path / name
        printed = ""
        for steps in runs:
            printed = _output("drq", *small, "--steps", str(steps), "--out", str(out))
            last = rf"^{steps} control steps, \d+ s: return \d+\.\d$"
            assert re.search(last, printed, re.MULTILINE), printed
        assert printed.count("return") == evaluations  # of the last command: none is repeated
        lines = (out / "curve.csv").read_text(encoding="utf-8").splitlines()
        rows = [line.split(",") for line in lines]
        assert [row[:2] for row in rows[1:]] == [[str(k * 160), str(k * 20)] for k in range(5)]
        curves.append([row[:2] + row[3:] for row in rows])  # but for the seconds
    assert curves[0] == curves[1]
    assert curves[0][1][3:] != curves[0][-1][3:]  # the policy has changed
    before = (out / "curve.csv").read_bytes()
    other = ("--task", "cartpole:swingup", "--steps", "960", "--out", str(out))
    refused = _run(str(_EXAMPLES / "drq.py"), *small, *other)
    why = "has a run with task 'cartpole:balance', not 'cartpole:swingup': choose another folder"
    assert (refused.returncode, refused.stderr) == (1, f"{out} {why}\n")
    assert (out / "curve.csv").read_bytes() == before


def test_policy_gymnasium(tmp_path: Path) -> None:
    write(tmp_path / "walk.safetensors")
    policy = ["--policy", str(tmp_path / "walk.safetensors")]
    printed = _output("policy_gymnasium", "--steps", "1010", *policy)
    expected = r"^walker walk: return \d+\.\d in 1010 steps, 1 episodes ended$"
    assert re.search(expected, printed, re.MULTILINE)


def test_policy_sb3(tmp_path: Path) -> None:
    write(tmp_path / "walk.safetensors")
    policy = ["--policy", str(tmp_path / "walk.safetensors")]
    printed = _output("policy_sb3", "--steps", "20", "--envs", "2", *policy)
    expected = r"^walker walk: return \d+\.\d \+- \d+\.\d over 2 episodes$"
    assert re.search(expected, printed, re.MULTILINE)


def test_torchrl_collect() -> None:
    printed = _output("torchrl_collect", "--steps", "1024", "--envs", "4")
    # 256 steps of each row; its collector resets rows without a step.
    assert re.search(r"^1024 transitions, \d+ a second, 8 episodes ended$", printed, re.MULTILINE)


@pytest.mark.ray
def test_rllib_ppo() -> None:
    printed = _output("rllib_ppo", "--steps", "512", "--envs", "4", "--seconds", "0.5")
    assert re.search(r"^512 steps, mean return \d+\.\d$", printed, re.MULTILINE)


@pytest.mark.gpu
def test_rsl_rl_ppo() -> None:
    printed = _output("rsl_rl_ppo", "--steps", "384", "--envs", "8", "--device", "cpu")
    assert re.search(
        r"^mean reward of a step: 0\.\d+, after learning 0\.\d+$", printed, re.MULTILINE
    )


@pytest.mark.gpu
def test_unilab_flash_sac(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # The first updates are after 40 of 41 steps of all rows.
    printed = _output("unilab_flash_sac", "--steps", "10500", "--envs", "256", "--device", "cpu")
    assert re.search(
        r"^mean reward of a step: 0\.\d+, after learning 0\.\d+$", printed, re.MULTILINE
    )
    # Its policy plays on the CPU.
    task, policy = ("cartpole", "swingup"), ("--policy", "unilab_flash_sac:Policy")
    printed = _printed(
        *("-m", "limberjack", "evaluate", *task, *policy, "--episodes", "2", "--time-limit", "1")
    )
    assert "unilab_flash_sac:Policy" in printed
