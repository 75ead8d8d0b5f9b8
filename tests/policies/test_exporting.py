"""Models of Stable-Baselines3 as policy files, which act as the models do."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.policies import PolicyError, exporting, mlp, onnx
from limberjack.policies.exporting import export
from tests.policies.saved_models import without_sb3
from tests.rollouts import run_episode


def test_only_models_of_stable_baselines3_are_exported(tmp_path: Path) -> None:
    for name in ("random", "planner", "mlp:walk.safetensors", "module:act"):
        with pytest.raises(PolicyError, match="expected sb3:PATH, a model to export"):
            export(name, tmp_path / "out")
    with pytest.raises(ValueError, match="action_repeat is 0"):
        export("sb3:walk.zip", tmp_path / "out", action_repeat=0)
    with pytest.raises(ValueError, match="'wlak' does not exist in domain 'walker'"):
        export("sb3:walk.zip", tmp_path / "out", task=("walker", "wlak"))


def test_without_stable_baselines3_the_error_says_what_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_sb3(monkeypatch)
    with pytest.raises(PolicyError, match=r"policy 'sb3:model\.zip': needs the extra 'sb3'"):
        export("sb3:model.zip", tmp_path / "out")


@pytest.fixture
def baselines(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Stable-Baselines3, with one thread, and without OpenAI's gym, which it looks for."""
    reason = "needs the extra 'sb3'"
    torch: Any = pytest.importorskip("torch", reason=reason)
    found: Any = pytest.importorskip("stable_baselines3", reason=reason)
    monkeypatch.setitem(sys.modules, "gym", None)  # the folder of tests of that name
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield found
    torch.set_num_threads(before)


def _algorithm(name: str, baselines: Any) -> Any:
    if hasattr(baselines, name):
        return getattr(baselines, name)
    contrib = pytest.importorskip("sb3_contrib", reason="needs sb3-contrib")
    return getattr(contrib, name)


def _envs(domain: str = "walker", task: str = "walk", **kwargs: Any) -> Any:
    sb3: Any = pytest.importorskip("limberjack.sb3", reason="needs the extra 'sb3'")
    return sb3.make_vec_env(domain, task, 2, seed=0, num_threads=1, **kwargs)


_OFF_POLICY = {"learning_starts": 8, "batch_size": 32, "gradient_steps": 40, "train_freq": 40}
_SETTINGS: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 40, "batch_size": 16},
    "A2C": {"n_steps": 40},
    "TRPO": {"n_steps": 40, "batch_size": 16},
    "SAC": _OFF_POLICY,
    "TD3": _OFF_POLICY,
    "DDPG": _OFF_POLICY,
    "TQC": _OFF_POLICY,
    "CrossQ": _OFF_POLICY,
}
_SMALL = {"net_arch": [16, 12]}


def _trained(
    path: Path,
    baselines: Any,
    name: str,
    envs: Any = None,
    policy: str = "MlpPolicy",
    **kwargs: Any,
) -> Any:
    """A model that has learned for a moment, which is saved."""
    settings = {"policy_kwargs": _SMALL, **_SETTINGS[name], **kwargs}
    settings["policy_kwargs"] = {**settings["policy_kwargs"]}  # which SB3 changes
    make = _algorithm(name, baselines)
    model = make(policy, envs or _envs(), seed=1, device="cpu", **settings)
    model.learn(80)
    model.save(path)
    return model


def _flat(domain: str = "walker", task: str = "walk") -> np.ndarray:
    """Observations of 64 rows after a step."""
    batch = suite.load_batch(domain, task, 64, num_threads=1, seed=3)
    batch.reset()
    actions = np.random.RandomState(0).uniform(-1, 1, batch.action_spec().shape)
    seen = batch.step(actions).observation
    flat = [values.reshape(64, -1) for values in seen.values()]
    return np.concatenate(flat, axis=-1).astype(np.float32)


def _assert_equal(path: Path, expected: np.ndarray, observations: np.ndarray) -> None:
    # Sums of float32 in another order; docs/policies.md promises 1e-5.
    np.testing.assert_allclose(mlp.load(path).actions(observations), expected, atol=1e-5)


@pytest.mark.parametrize("name", ["PPO", "CrossQ"])
def test_a_file_that_ends_in_onnx_is_a_model_of_onnx(
    name: str, baselines: Any, tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime", reason="needs the extra 'onnx'")
    model = _trained(tmp_path / "model.zip", baselines, name)
    out = tmp_path / "p.onnx"
    card = export(f"sb3:{tmp_path / 'model.zip'}", out, task=("walker", "walk"))
    expected, _ = model.predict(_flat(), deterministic=True)
    # Sums of float32 in another order; docs/policies.md promises 1e-5.
    np.testing.assert_allclose(onnx.load(out).actions(_flat()), expected, atol=1e-5)
    assert onnx.load(out).card == card
    assert card.title == "walker walk"


def test_a_model_is_not_replaced_by_its_own_policy(baselines: Any, tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    _trained(path, baselines, "PPO")
    before = path.read_bytes()
    with pytest.raises(PolicyError, match=r"model\.zip is the model itself: choose another file"):
        export(f"sb3:{tmp_path / 'model'}", path)
    assert path.read_bytes() == before


def test_a_model_of_onnx_is_not_written_without_the_extra(
    baselines: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _trained(tmp_path / "model.zip", baselines, "PPO")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(PolicyError, match="needs the extra 'onnx': pip install onnx onnxruntime"):
        export(f"sb3:{tmp_path / 'model.zip'}", tmp_path / "p.onnx")
    assert not (tmp_path / "p.onnx").exists()


@pytest.mark.parametrize("name", _SETTINGS)
def test_an_exported_model_acts_as_the_model_does(
    name: str, baselines: Any, tmp_path: Path
) -> None:
    model = _trained(tmp_path / "model.zip", baselines, name)
    card = export(f"sb3:{tmp_path / 'model.zip'}", tmp_path / "p", action_repeat=2)
    expected, _ = model.predict(_flat(), deterministic=True)
    assert np.ptp(expected, axis=0).min() > 0
    _assert_equal(tmp_path / "p", expected, _flat())
    assert card == mlp.load(tmp_path / "p").card
    assert card.algorithm == ("TD3" if name == "DDPG" else name)
    assert (card.sizes, card.action_repeat, card.seeds) == ((24, 16, 12, 6), 2, (1,))
    assert card.layout == (("observations", (24,)),)
    assert (card.title, card.steps) == ("", 2 * model.num_timesteps)


@pytest.mark.parametrize("name", ["PPO", "SAC", "CrossQ"])
def test_the_normalisation_beside_a_model_is_exported(
    name: str, baselines: Any, tmp_path: Path
) -> None:
    vec_env: Any = pytest.importorskip("stable_baselines3.common.vec_env")
    envs = vec_env.VecNormalize(_envs(), clip_obs=1.5)
    model = _trained(tmp_path / "model.zip", baselines, name, envs)
    envs.save(tmp_path / "model.vecnormalize.pkl")
    card = export(f"sb3:{tmp_path / 'model.zip'}", tmp_path / "p")
    seen = envs.normalize_obs(_flat())
    assert (np.abs(seen) == 1.5).any()
    _assert_equal(tmp_path / "p", model.predict(seen, deterministic=True)[0], _flat())
    assert card.clip == 1.5


_KINDS: list[dict[str, Any]] = [
    {"net_arch": []},
    {"net_arch": [8]},
    {"activation_fn": "ELU"},
    {"activation_fn": "SiLU"},
    {"activation_fn": "LeakyReLU"},
    {"activation_fn": "ReLU6"},
    {"net_arch": [8, 8, 8, 8], "activation_fn": "Tanh"},
]


@pytest.mark.parametrize("name", ["PPO", "SAC", "CrossQ"])
@pytest.mark.parametrize("kind", _KINDS)
def test_networks_of_any_size_and_activation_are_exported(
    name: str, kind: dict[str, Any], baselines: Any, tmp_path: Path
) -> None:
    torch: Any = pytest.importorskip("torch")
    kwargs = {**_SMALL, **kind}
    if "activation_fn" in kwargs:
        kwargs["activation_fn"] = getattr(torch.nn, kwargs["activation_fn"])
    if name == "CrossQ" and not kwargs["net_arch"]:
        kwargs["net_arch"] = {"pi": [], "qf": [8]}
    model = _trained(tmp_path / "model.zip", baselines, name, policy_kwargs=kwargs)
    export(f"sb3:{tmp_path / 'model.zip'}", tmp_path / "p")
    _assert_equal(tmp_path / "p", model.predict(_flat(), deterministic=True)[0], _flat())


def test_a_model_of_a_dictionary_of_observations_is_exported(
    baselines: Any, tmp_path: Path
) -> None:
    vec_env: Any = pytest.importorskip("stable_baselines3.common.vec_env")
    envs = vec_env.VecNormalize(_envs("stacker", "stack_2", flat=False))
    model = _trained(tmp_path / "model.zip", baselines, "SAC", envs, "MultiInputPolicy")
    envs.save(tmp_path / "model.vecnormalize.pkl")
    name = f"sb3:{tmp_path / 'model.zip'}"
    card = export(name, tmp_path / "p", task=("stacker", "stack_2"))
    environment = suite.load("stacker", "stack_2", {"random": 4, "time_limit": 0.1})
    assert dict(card.layout) == {n: s.shape for n, s in environment.observation_spec().items()}
    totals = []
    for each in (name, f"mlp:{tmp_path / 'p'}"):
        totals.append(run_episode(environment, policies.find(each, environment), 4).total)
        environment.reseed(4)
    # Actions differ by some 1e-7, as above, and the states of these 10 steps with them.
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-6)
    assert model.num_timesteps == 80


def test_a_normalisation_of_some_observations_only_is_refused(
    baselines: Any, tmp_path: Path
) -> None:
    vec_env: Any = pytest.importorskip("stable_baselines3.common.vec_env")
    envs = _envs("stacker", "stack_2", flat=False)
    names = list(envs.observation_space.spaces)
    envs = vec_env.VecNormalize(envs, norm_obs_keys=names[1:])
    _trained(tmp_path / "model.zip", baselines, "PPO", envs, "MultiInputPolicy")
    envs.save(tmp_path / "model.vecnormalize.pkl")
    _refused(f"its VecNormalize leaves {names[0]} as it is, and not others", tmp_path / "model.zip")


def test_a_model_with_a_task_has_its_layout_and_model(baselines: Any, tmp_path: Path) -> None:
    _trained(tmp_path / "model.zip", baselines, "PPO")
    name = f"sb3:{tmp_path / 'model.zip'}"
    card = export(name, tmp_path / "p", task=("walker", "walk"))
    assert [name for name, _ in card.layout] == ["orientations", "height", "velocity"]
    assert (card.title, len(card.fingerprint)) == ("walker walk", 64)
    for other, message in (
        (("cheetah", "run"), "it takes 24 numbers as observation; the task has 17"),
        (("hopper", "hop"), "it takes 24 numbers as observation; the task has 15"),
    ):
        with pytest.raises(PolicyError, match=f"does not fit: {message}"):
            export(name, tmp_path / "other", task=other)
    assert not (tmp_path / "other").exists()


def test_a_task_is_a_domain_and_a_task(tmp_path: Path) -> None:
    task: Any = "walker:walk"
    with pytest.raises(
        TypeError, match=r"task is 'walker:walk'; expected a domain and a task, as \("
    ):
        export("sb3:none.zip", tmp_path / "p", task=task)


@pytest.mark.parametrize("bound", [1e-5, 1.0, 1e30])
def test_a_file_that_acts_otherwise_is_not_written(bound: float, tmp_path: Path) -> None:
    """By a ten thousandth of its range, or of its actions where the range is wide."""
    card = mlp.Card(layout=(("observations", (1,)),), low=(-bound,), high=(bound,))
    network = mlp.Mlp([(np.zeros((1, 1)), np.zeros(1))], card)

    def acting(action: float) -> Any:
        def predict(seen: np.ndarray, deterministic: bool) -> tuple[np.ndarray, None]:
            return np.full((len(seen), 1), action), None

        data = {"observation_space": SimpleNamespace(shape=(1,))}
        policy = SimpleNamespace(predict=predict)
        return SimpleNamespace(data=data, policy=policy, normalisation=None)

    scale = min(bound, 1.0)
    exporting._check_equal(acting(1e-6 * scale), network)
    with pytest.raises(ValueError, match=r"an action differs by 0\.0001"):
        exporting._check_equal(acting(1e-4 * scale), network)


def _refused(message: str, path: Path) -> None:
    with pytest.raises(PolicyError, match=f"policy 'sb3:.*': {message}") as caught:
        export(f"sb3:{path}", path.with_name("p"))
    assert "\n" not in str(caught.value)
    assert not path.with_name("p").exists()


def _steep() -> Any:
    torch: Any = pytest.importorskip("torch")
    return torch.nn.LeakyReLU(0.5)


def test_networks_without_a_form_in_the_format_are_refused_by_name(
    baselines: Any, tmp_path: Path
) -> None:
    torch: Any = pytest.importorskip("torch")
    path = tmp_path / "model.zip"
    _trained(path, baselines, "PPO", policy_kwargs={"activation_fn": torch.nn.GELU})
    _refused("it has a GELU, which has no form in a policy file", path)
    _trained(path, baselines, "SAC", use_sde=True)
    _refused("it has a Hardtanh, which has no form in a policy file", path)
    _trained(path, baselines, "PPO", policy_kwargs={"activation_fn": _steep})
    _refused("the file would act otherwise: an action differs by", path)
    path.write_text("no model")
    _refused(".* is not a model of Stable-Baselines3", path)


def test_exploration_of_states_does_not_change_what_is_exported(
    baselines: Any, tmp_path: Path
) -> None:
    for squashes in (False, True):
        kwargs = {**_SMALL, "squash_output": squashes}
        path = tmp_path / f"{squashes}.zip"
        model = _trained(path, baselines, "PPO", use_sde=True, policy_kwargs=kwargs)
        card = export(f"sb3:{path}", tmp_path / "p")
        assert card.end == ("tanh" if squashes else "none")
        _assert_equal(tmp_path / "p", model.predict(_flat(), deterministic=True)[0], _flat())
