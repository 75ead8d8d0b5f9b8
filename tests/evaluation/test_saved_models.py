"""Models that Stable-Baselines3 has saved."""

import pickle
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.data import collect
from limberjack.evaluation import evaluate
from limberjack.policies import Actor, PolicyError
from limberjack.rl.batches import batch_of
from tests.episodes.collected import hashes, of_64, whole_hashes
from tests.rl import odd_environments
from tests.rollouts import run_episode

_REASON = "needs the extra 'sb3'"
torch: Any = pytest.importorskip("torch", reason=_REASON)
baselines: Any = pytest.importorskip("stable_baselines3", reason=_REASON)
vec_env: Any = pytest.importorskip("stable_baselines3.common.vec_env")
sb3: Any = pytest.importorskip("limberjack.sb3")

_ALGORITHMS = {
    "PPO": {"n_steps": 8, "batch_size": 16},
    "SAC": {"learning_starts": 0},
    "TD3": {"policy_kwargs": {"net_arch": [16]}},
}


@pytest.fixture(autouse=True)
def _no_old_gym(monkeypatch: pytest.MonkeyPatch) -> None:
    """SB3 looks for OpenAI's gym as it saves, and would find the folder of tests of that name."""
    monkeypatch.setitem(sys.modules, "gym", None)


def _envs(task: str = "stand", **kwargs: Any) -> Any:
    return sb3.make_vec_env("humanoid", task, 2, seed=0, num_threads=1, **kwargs)


def _saved(path: Path, algorithm: str = "PPO", envs: Any = None, policy: str = "MlpPolicy") -> Any:
    """An untrained model, which is saved."""
    settings = _ALGORITHMS[algorithm]
    made = getattr(baselines, algorithm)(policy, envs or _envs(), seed=1, device="cpu", **settings)
    made.save(path)
    return made


def _find(path: Path) -> Actor:
    return policies.find(f"sb3:{path}", suite.load("humanoid", "stand"))


def _observations() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Of 64 rows: by name, and as SB3 sees them."""
    batch = suite.load_batch("humanoid", "stand", 64, num_threads=1, seed=3)
    seen = batch.reset().observation
    flat = np.concatenate([values.reshape(64, -1) for values in seen.values()], axis=-1)
    return seen, flat.astype(np.float32)


def _act(
    found: Actor, observations: Any, domain: str = "humanoid", task: str = "stand"
) -> np.ndarray:
    batch = suite.load_batch(domain, task, 64, num_threads=1)
    found.begin(batch, np.arange(64), range(64))
    return found.act(observations, np.arange(64))


@pytest.mark.parametrize("algorithm", _ALGORITHMS)
def test_a_saved_model_acts_as_the_model_does(algorithm: str, tmp_path: Path) -> None:
    model = _saved(tmp_path / "model.zip", algorithm)
    observations, flat = _observations()
    expected, _ = model.predict(flat, deterministic=True)
    np.testing.assert_array_equal(_act(_find(tmp_path / "model.zip"), observations), expected)


def test_a_model_without_gradients_acts_as_it_did(tmp_path: Path) -> None:
    contrib = pytest.importorskip("sb3_contrib", reason=_REASON)
    model = contrib.ARS("LinearPolicy", _envs(), seed=1, device="cpu")
    model.save(tmp_path / "model.zip")
    observations, flat = _observations()
    expected, _ = model.predict(flat, deterministic=True)
    np.testing.assert_array_equal(_act(_find(tmp_path / "model.zip"), observations), expected)


def test_a_model_of_a_dictionary_of_observations_acts_too(tmp_path: Path) -> None:
    # Not a humanoid: SB3 cannot flatten a dictionary with single numbers.
    envs = sb3.make_vec_env("stacker", "stack_2", 2, seed=0, num_threads=1, flat=False)
    model = _saved(tmp_path / "model.zip", envs=envs, policy="MultiInputPolicy")
    batch = suite.load_batch("stacker", "stack_2", 64, num_threads=1, seed=3)
    observations = batch.reset().observation
    seen = {name: values.astype(np.float32) for name, values in observations.items()}
    expected, _ = model.predict(seen, deterministic=True)
    # The name may be given as to `save`, without '.zip'.
    found = policies.find(f"sb3:{tmp_path / 'model'}", suite.load("stacker", "stack_2"))
    np.testing.assert_array_equal(_act(found, observations, "stacker", "stack_2"), expected)


def test_observations_are_normalised_as_in_training(tmp_path: Path) -> None:
    envs = vec_env.VecNormalize(_envs())
    model = _saved(tmp_path / "model.zip", envs=envs)
    envs.reset()
    for _ in range(5):
        envs.step(np.zeros((2, 21)))
    plain = _find(tmp_path / "model.zip")
    envs.save(tmp_path / "model.vecnormalize.pkl")
    found = _find(tmp_path / "model.zip")
    observations, flat = _observations()
    expected, _ = model.predict(envs.normalize_obs(flat), deterministic=True)
    np.testing.assert_array_equal(_act(found, observations), expected)
    assert (_act(plain, observations) != expected).any()
    assert found.sha256 != plain.sha256


def test_a_saved_model_is_evaluated_and_named(tmp_path: Path) -> None:
    _saved(tmp_path / "model.zip")
    name = f"sb3:{tmp_path / 'model.zip'}"
    evaluation = evaluate("humanoid", "stand", name, range(3), time_limit=0.1, num_threads=1)
    assert evaluation.policy == name
    assert evaluation.facts["policy_sha256"] == _find(tmp_path / "model.zip").sha256
    assert evaluation.summary().episodes == 3


def test_a_saved_model_plays_the_same_episodes_alone(tmp_path: Path) -> None:
    _saved(tmp_path / "model.zip")
    name = f"sb3:{tmp_path / 'model.zip'}"
    evaluation = evaluate("humanoid", "stand", name, range(3), time_limit=0.1, num_threads=1)
    for score in evaluation.scores[name]:
        environment = suite.load("humanoid", "stand", {"random": score.seed, "time_limit": 0.1})
        policy = policies.find(name, environment)
        assert run_episode(environment, policy, score.seed).total == score.total


def test_workers_and_shards_play_a_saved_model_to_the_same_files(tmp_path: Path) -> None:
    _saved(tmp_path / "model.zip")
    played = ("humanoid", "stand", f"sb3:{tmp_path / 'model.zip'}", range(62, 130))
    how: dict[str, dict[str, Any]] = {
        "workers-2": {"workers": 2},
        "workers-4": {"workers": 4},
        "shards": {"num_threads": 1},
    }
    file_mb = of_64(("humanoid", "stand", 0.1))
    for number in (1, 2, 3):
        part: dict[str, Any] = {"time_limit": 0.1, "shard": (number, 3)}
        evaluate(*played, out=tmp_path / "shards", **part)
        collect(*played, out=tmp_path / "data-shards", file_mb=file_mb, **part)
    for name, options in {"one": {"num_threads": 1}, **how}.items():
        evaluate(*played, out=tmp_path / name, time_limit=0.1, **options)
        out = tmp_path / f"data-{name}"
        collect(*played, out=out, time_limit=0.1, file_mb=file_mb, **options)
    for name in how:
        assert _files(tmp_path / name) == _files(tmp_path / "one")
        assert whole_hashes(tmp_path / f"data-{name}") == whole_hashes(tmp_path / "data-one")
    assert len(hashes(tmp_path / "data-one")) == 3


def _files(directory: Path) -> tuple[list[bytes], bytes]:
    """The lines of episodes.jsonl in order, and result.json."""
    lines = (directory / "episodes.jsonl").read_bytes().splitlines()
    return [lines[0], *sorted(lines[1:])], (directory / "result.json").read_bytes()


def test_files_that_are_not_models_of_the_task_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no model")
    _saved(tmp_path / "other.zip", envs=_envs("run_pure_state"))
    for name, message in (
        ("text.zip", "is not a model of Stable-Baselines3; expected a file that model.save wrote"),
        ("none.zip", "No such file"),
        ("", "is a folder; expected the file that model.save wrote"),
        ("other.zip", r"the model's observations have shape \(55,\); the task's have \(67,\)"),
    ):
        with pytest.raises(PolicyError, match=message):
            _find(tmp_path / name)


def test_a_damaged_model_is_one_error_that_names_the_file(tmp_path: Path) -> None:
    _saved(tmp_path / "whole.zip")
    with (
        zipfile.ZipFile(tmp_path / "whole.zip") as whole,
        zipfile.ZipFile(tmp_path / "cut.zip", "w") as cut,
    ):
        for name in whole.namelist():
            content = whole.read(name)
            cut.writestr(name, content[:1000] if name == "policy.pth" else content)
    with pytest.raises(
        PolicyError, match=r"cut.zip cannot be read .*expected a file that model.save"
    ):
        _find(tmp_path / "cut.zip")


def test_a_file_that_is_cut_off_is_called_damaged(tmp_path: Path) -> None:
    _saved(tmp_path / "whole.zip")
    content = (tmp_path / "whole.zip").read_bytes()
    (tmp_path / "half.zip").write_bytes(content[: len(content) // 2])  # has a whole file within
    with pytest.raises(PolicyError, match=r"half\.zip (.*: it is damaged|is not a model)"):
        _find(tmp_path / "half.zip")


def test_networks_of_another_shape_are_one_error_that_names_the_file(tmp_path: Path) -> None:
    _saved(tmp_path / "whole.zip")
    _saved(tmp_path / "other.zip", envs=_envs("run_pure_state"))
    with (
        zipfile.ZipFile(tmp_path / "whole.zip") as whole,
        zipfile.ZipFile(tmp_path / "other.zip") as other,
        zipfile.ZipFile(tmp_path / "mixed.zip", "w") as mixed,
    ):
        for name in whole.namelist():
            mixed.writestr(name, (other if name == "policy.pth" else whole).read(name))
    with pytest.raises(PolicyError, match=r"(?s)mixed\.zip cannot be read .*of its own class"):
        _find(tmp_path / "mixed.zip")


@pytest.mark.parametrize("content", [b"", b"no pickle", pickle.dumps({"obs_rms": 1})])
def test_a_damaged_normalisation_is_one_error_that_names_the_file(
    content: bytes, tmp_path: Path
) -> None:
    _saved(tmp_path / "model.zip")
    (tmp_path / "model.vecnormalize.pkl").write_bytes(content)
    with pytest.raises(
        PolicyError, match=r"pkl cannot be read .*expected a file that VecNormalize.save"
    ):
        _find(tmp_path / "model.zip")


def test_a_normalisation_of_other_observations_is_refused(tmp_path: Path) -> None:
    _saved(tmp_path / "model.zip")
    other = vec_env.VecNormalize(_envs("run_pure_state"))
    other.save(tmp_path / "model.vecnormalize.pkl")
    with pytest.raises(
        PolicyError, match=r"normalises observations of shape \(55,\); the model's have"
    ):
        _find(tmp_path / "model.zip")


def test_a_model_acts_on_observations_in_one_array_without_a_name(tmp_path: Path) -> None:
    envs = sb3.VecEnv(batch_of(odd_environments.joined, 2, 1, seed=0))
    _saved(tmp_path / "model.zip", envs=envs)
    policy = f"sb3:{tmp_path / 'model.zip'}"
    (score,) = evaluate(odd_environments.joined, None, policy, [3]).scores[policy]
    env = odd_environments.joined(3)
    act = policies.find(policy, env).begin_alone(env, 3)
    time_step, total = env.reset(), 0.0
    while not time_step.last():
        time_step = env.step(act({"observations": time_step.observation}))
        total += time_step.reward
    assert score.total == total
