"""The vector environment of tensors: resets, steps, modes, info, saved rows, and bad input."""

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium import error

from limberjack import gym, suite
from limberjack.rl.randomize import scale

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
gpu: Any = pytest.importorskip("limberjack.gpu.vector")

_ROWS = 8
_DEVICE: dict[str, Any] = {"device": "cpu", "seed": 0}
_SHORT = 0.06  # seconds: 6 steps of the cheetah
_CONTINUED: list[tuple[str, str, dict[str, Any]]] = [
    ("humanoid", "walk", {}),
    ("manipulator", "bring_ball", {}),
    ("cheetah", "run", {"randomize": {"body_mass": scale(0.5, 2.0)}}),
]


def _envs(domain: str = "cheetah", task: str = "run", rows: int = _ROWS, **kwargs: Any) -> Any:
    return gpu.load_vector(domain, task, rows, **{**_DEVICE, **kwargs})


def _actions(envs: Any, value: float = 0.3) -> Any:
    return torch.full(envs.action_space.shape, value)


@pytest.fixture(scope="module")
def cheetah() -> Iterator[Any]:
    """A vector environment in next-step mode, of short episodes."""
    envs = _envs(time_limit=_SHORT)
    yield envs
    envs.close()


def _close(found: Any, expected: Any, tolerance: float = 1e-4) -> None:
    np.testing.assert_allclose(as_numpy(found), expected, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("repeat", [1, 3])
def test_episodes_end_and_begin_as_on_the_cpu_in_each_mode(mode: str, repeat: int) -> None:
    # One control step more than six actions, if actions are repeated.
    limit = _SHORT if repeat == 1 else 0.16
    kwargs: dict[str, Any] = {"time_limit": limit, "autoreset_mode": mode, "flat": True}
    kwargs["action_repeat"] = repeat
    ours = _envs(**kwargs)
    theirs = gym.load_vector("cheetah", "run", _ROWS, dtype="float32", num_threads=1, **kwargs)
    found, info = ours.reset()
    expected, _ = theirs.reset(seed=0)
    _close(found, expected)
    assert info == {}
    assert (ours.dt, ours.metadata["render_fps"]) == (theirs.dt, theirs.metadata["render_fps"])
    for step in range(16):
        found, reward, terminated, truncated, info = ours.step(_actions(ours))
        expected, *others, expected_info = theirs.step(as_numpy(_actions(ours)))
        np.testing.assert_array_equal(as_numpy(terminated), others[1])
        np.testing.assert_array_equal(as_numpy(truncated), others[2])
        assert set(expected_info) <= set(info)
        for key in ("_reward_terms", "_success", "_diverged"):
            np.testing.assert_array_equal(as_numpy(info[key]), expected_info[key])
        if step < 6:  # later episodes have other starts
            _close(reward, others[0])
        if step < 5 or (mode == "NextStep" and step == 5):
            _close(found, expected, 1e-3)
        if mode == "SameStep" and step == 5:
            assert as_numpy(info["_final_obs"]).all()
            _close(info["final_obs"], np.stack(list(expected_info["final_obs"])), 1e-3)
            assert set(info["final_info"]) == set(expected_info["final_info"])
    ours.close()
    theirs.close()


def test_a_row_that_is_not_reset_keeps_reporting_its_end() -> None:
    envs = _envs(time_limit=_SHORT, autoreset_mode="Disabled", rows=3)
    envs.reset()
    for _ in range(6):
        envs.step(_actions(envs))
    _, reward, _, truncated, _ = envs.step(_actions(envs))
    assert as_numpy(truncated).all()
    assert not as_numpy(reward).any()
    mask = torch.tensor([True, False, True])
    observations, _ = envs.reset(options={"reset_mask": mask})
    again, _ = envs.reset(options={"reset_mask": as_numpy(mask)}, seed=[5, None, 6])
    np.testing.assert_array_equal(as_numpy(again)[1], as_numpy(observations)[1])
    first = suite.load_batch("cheetah", "run", 2, 1, seed=5).reset().observation
    _close(again[0, :8], first["position"][0])
    _close(again[2, :8], first["position"][1])
    _, reward, _, truncated, _ = envs.step(_actions(envs))
    np.testing.assert_array_equal(as_numpy(truncated), [False, True, False])
    assert as_numpy(reward)[1] == 0
    envs.close()


def test_seeds_repeat_an_episode_and_later_starts_differ(cheetah: Any) -> None:
    first, _ = cheetah.reset(seed=3)
    second, _ = cheetah.reset()
    third, _ = cheetah.reset(seed=3)
    np.testing.assert_array_equal(as_numpy(first), as_numpy(third))
    expected = suite.load_batch("cheetah", "run", _ROWS, 1, seed=3).reset().observation
    _close(first[:, :8], expected["position"], 1e-6)
    # The ring begins with the first starts; each is replaced before episodes of full length end.
    assert as_numpy(second).shape == as_numpy(first).shape


def test_starts_are_used_once_where_episodes_are_full_length(cheetah: Any) -> None:
    cheetah.reset(seed=0)
    seen = []
    for _ in range(5 * 7):
        observations, _, _, _, info = cheetah.step(_actions(cheetah))
        if as_numpy(~info["_reward_terms"]).all():  # the rows have begun an episode
            seen.append(as_numpy(observations))
    starts = np.concatenate(seen)
    assert len(starts) == 5 * _ROWS
    assert len(np.unique(starts, axis=0)) == len(starts)


def test_rows_that_do_not_begin_an_episode_keep_their_bits() -> None:
    one, other = (_envs(time_limit=100.0, autoreset_mode="Disabled") for _ in range(2))
    for envs in (one, other):
        envs.reset(seed=0)
    for _ in range(4):
        mask = torch.zeros(_ROWS, dtype=torch.bool)
        mask[2] = True
        other.reset(options={"reset_mask": mask})
        found, expected = (envs.step(_actions(envs))[0] for envs in (one, other))
        rows = np.arange(_ROWS) != 2
        np.testing.assert_array_equal(as_numpy(found)[rows], as_numpy(expected)[rows])
    one.close()
    other.close()


def test_a_row_that_diverges_ends_is_flagged_and_begins_again(cheetah: Any) -> None:
    cheetah.reset(seed=0)
    cheetah.batch.simulation.live("qvel")[3] = float("nan")
    cheetah.batch.simulation.live("qpos")[5] = 1e11
    observations, reward, terminated, _, info = cheetah.step(_actions(cheetah))
    flagged = [row in (3, 5) for row in range(_ROWS)]
    for mask in (terminated, info["diverged"], ~info["_reward_terms"], reward == 0):
        np.testing.assert_array_equal(as_numpy(mask), flagged)
    assert np.isfinite(as_numpy(observations)).all()
    observations, reward, terminated, _, info = cheetah.step(_actions(cheetah))
    assert not as_numpy(terminated).any()
    assert not as_numpy(info["diverged"]).any()
    np.testing.assert_array_equal(as_numpy(~info["_reward_terms"]), flagged)
    for _ in range(3):
        observations, *_ = cheetah.step(_actions(cheetah))
        assert np.isfinite(as_numpy(observations)).all()


def test_an_action_that_is_not_finite_ends_its_row_alone(cheetah: Any) -> None:
    cheetah.reset(seed=0)
    actions = _actions(cheetah)
    actions[1, 0], actions[4, 2] = float("nan"), float("inf")
    _, _, terminated, _, info = cheetah.step(actions)
    expected = [row in (1, 4) for row in range(_ROWS)]
    np.testing.assert_array_equal(as_numpy(terminated), expected)
    np.testing.assert_array_equal(as_numpy(info["diverged"]), expected)
    actions = torch.full_like(actions, float("nan"))
    _, _, terminated, _, info = cheetah.step(actions)  # rows that begin ignore their action
    np.testing.assert_array_equal(as_numpy(terminated), [not ended for ended in expected])


def test_drawn_fields_are_in_the_info_where_episodes_begin() -> None:
    envs = _envs(time_limit=_SHORT, randomize={"body_mass": scale(0.5, 2.0)})
    _, info = envs.reset(seed=0)
    batch = suite.load_batch(
        "cheetah", "run", _ROWS, 1, environment_kwargs={"randomize": {"body_mass": scale(0.5, 2.0)}}
    )
    batch.reset(seeds=list(range(_ROWS)))
    drawn = info["randomization"]
    np.testing.assert_array_equal(
        as_numpy(drawn["body_mass"]), np.float32(batch.randomization["body_mass"])
    )
    assert as_numpy(drawn["_body_mass"]).all()
    for _ in range(7):
        *_, info = envs.step(_actions(envs))
    later = as_numpy(info["randomization"]["body_mass"])
    assert as_numpy(info["_randomization"]).all()
    assert (later[:, 1] != as_numpy(drawn["body_mass"])[:, 1]).all()
    envs.close()


def test_spaces_and_layout_are_those_of_the_cpu(cheetah: Any) -> None:
    theirs = gym.load_vector("cheetah", "run", _ROWS, flat=True, dtype="float32", num_threads=1)
    for name in ("action_space", "observation_space", "single_observation_space", "layout"):
        assert getattr(cheetah, name) == getattr(theirs, name)
    assert repr(cheetah) == "<VectorEnv cheetah:run, 8 rows, cpu>"


def test_observations_are_plain_tensors_that_later_steps_leave_alone(cheetah: Any) -> None:
    observations, _ = cheetah.reset(seed=0)
    kept = observations.clone()
    results = cheetah.step(_actions(cheetah))
    info = results[-1]
    for value in (*results[:4], info["diverged"], *info["reward_terms"].values()):
        assert type(value) is torch.Tensor
    before = [value.clone() for value in results[:4]]
    cheetah.step(_actions(cheetah, -1.0))
    np.testing.assert_array_equal(as_numpy(observations), as_numpy(kept))
    for value, kept in zip(results[:4], before, strict=True):
        np.testing.assert_array_equal(as_numpy(value), as_numpy(kept))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("repeat", [1, 3])
def test_nothing_waits_for_the_device_in_a_hundred_control_steps(mode: str, repeat: int) -> None:
    from torch.utils._python_dispatch import (  # pyright: ignore[reportMissingImports]
        TorchDispatchMode,
    )

    waits: list[str] = []

    class Watch(TorchDispatchMode):
        def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None):
            if func.overloadpacket.__name__ in ("_local_scalar_dense", "nonzero", "equal"):
                waits.append(str(func))
            return func(*args, **(kwargs or {}))

    envs = _envs(time_limit=_SHORT, autoreset_mode=mode, rows=2, action_repeat=repeat)
    envs.reset()
    actions = _actions(envs)
    with Watch():
        for _ in range(100 // repeat):
            envs.step(actions)
    assert waits == []
    envs.close()


@pytest.mark.parametrize("repeat", [0, 1.5, True])
def test_a_wrong_action_repeat_is_refused(repeat: Any) -> None:
    with pytest.raises(ValueError, match=r"action_repeat is .*; expected a whole number"):
        _envs(action_repeat=repeat)


def test_a_state_dict_continues_with_the_same_bits(cheetah: Any) -> None:
    cheetah.reset(seed=0)
    cheetah.step(_actions(cheetah))
    file = io.BytesIO()
    torch.save(cheetah.state_dict(), file)
    file.seek(0)
    saved = torch.load(file)
    expected = [cheetah.step(_actions(cheetah, 0.1 * i))[:4] for i in range(9)]
    other = _envs(time_limit=_SHORT, seed=77)
    observations = other.load_state_dict(saved)
    assert observations.shape == (_ROWS, 17)
    for i, results in enumerate(expected):
        for found, value in zip(other.step(_actions(other, 0.1 * i))[:4], results, strict=True):
            np.testing.assert_array_equal(as_numpy(found), as_numpy(value))
    before = other.state_dict()["rows"]
    for wrong, message in (
        ({**saved, "rows": saved["rows"][:2]}, "the state has rows of shape"),
        ({**saved, "steps": saved["steps"][:2]}, "the state has steps of shape"),
        ({name: saved[name] for name in saved if name != "head"}, r"it lacks \['head'\]"),
        (None, "expected the result of state_dict; got None"),
        ({**saved, "ring": None}, "the state has ring of shape"),
        ({**saved, "random": ("MT19937",)}, "the random stream of the state is damaged"),
        ({**saved, "parts": ["other", *saved["parts"][1:]]}, r"the state is of \['other'\]; exp"),
    ):
        with pytest.raises(ValueError, match=message):
            other.load_state_dict(wrong)
    np.testing.assert_array_equal(as_numpy(other.state_dict()["rows"]), as_numpy(before))
    other.close()


def test_bad_actions_are_refused_with_advice(cheetah: Any) -> None:
    cheetah.reset(seed=0)
    for actions, kind, message in (
        (np.zeros((_ROWS, 6)), TypeError, "actions are a ndarray; expected a torch.Tensor on cpu"),
        (_actions(cheetah).double(), TypeError, r"torch\.float64; expected torch\.float32"),
        (_actions(cheetah)[:3], ValueError, r"shape \(3, 6\); expected \(8, 6\)"),
        (_actions(cheetah).to("meta"), ValueError, "actions are on meta; expected cpu"),
    ):
        with pytest.raises(kind, match=message):
            cheetah.step(actions)


def test_bad_resets_are_refused(cheetah: Any) -> None:
    for kwargs, kind, message in (
        ({"seed": [1, 2]}, ValueError, "2 seeds; expected 8"),
        ({"options": {"reset_mask": torch.ones(3, dtype=torch.bool)}}, ValueError, r"shape \(3,\)"),
        ({"options": {"reset_mask": torch.ones(8)}}, TypeError, "array of booleans"),
        ({"seed": -1}, ValueError, "-1"),
    ):
        with pytest.raises(kind, match=message):
            cheetah.reset(**kwargs)


@pytest.mark.parametrize(
    ("kwargs", "kind", "message"),
    [
        ({"pixels": {"camera": 0}}, ValueError, "pixels is .* no pictures are drawn on a device"),
        ({"render_mode": "rgb_array"}, ValueError, "render_mode is 'rgb_array': no pictures"),
        ({"environment_kwargs": {"pixels": {"camera": 0}}}, ValueError, "pixels is"),
        ({"environment_kwargs": {"legacy_step": False}}, ValueError, "legacy_step is False"),
        ({"autoreset_mode": "SameStop"}, ValueError, "Did you mean 'SameStep'"),
        ({"nconmax": 0}, ValueError, "nconmax is 0"),
        ({"pixels": False}, ValueError, "pixels is False: no pictures"),
        ({"starts_per_step": -1}, ValueError, "starts_per_step is -1; expected a finite number"),
        ({"starts_per_step": float("inf")}, ValueError, "starts_per_step is inf; expected"),
        ({"starts_per_step": float("nan")}, ValueError, "starts_per_step is nan; expected"),
        ({"num_thread": 2}, TypeError, "got an unexpected keyword argument 'num_thread'"),
        ({"rows": 0}, ValueError, "num_envs is 0"),
        ({"rows": 10**9}, MemoryError, "num_envs is 1000000000, which takes"),
    ],
)
def test_bad_arguments_are_refused_by_name(
    kwargs: dict[str, Any], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        _envs(**kwargs)


def test_tasks_that_remember_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    of_suite = suite.load("cartpole", "swingup")
    task = type("Remembers", (type(of_suite.task),), {"EPISODE_ATTRIBUTES": ("last",), "last": 0.0})
    of_suite.task.__class__ = task
    monkeypatch.setattr(suite, "load", lambda *_: of_suite)
    with pytest.raises(ValueError, match="task Remembers remembers last"):
        gpu.load_vector("cartpole", "swingup", 2, device="cpu")


def test_pictures_are_refused_and_a_closed_environment_says_so() -> None:
    envs = _envs(rows=2)
    with pytest.raises(error.ResetNeeded, match="call reset"):
        envs.step(_actions(envs))
    with pytest.raises(error.ResetNeeded, match="call reset"):
        envs.to_cpu([0])
    with pytest.raises(RuntimeError, match=r"no pictures .* to_cpu\(rows\)"):
        envs.render()
    envs.close()
    with pytest.raises(error.ClosedEnvironmentError):
        envs.reset()


def test_overflows_are_counted_and_shown(caplog: pytest.LogCaptureFixture) -> None:
    envs = _envs(nconmax=4, njmax=2)
    envs.reset(seed=0)
    marked = sum(int(envs.step(_actions(envs))[-1]["overflow"].sum()) for _ in range(20))
    assert envs.overflows == marked > 0
    envs.close()
    assert "pass more than nconmax=4, njmax=2" in caplog.text


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_recorded_kernels_give_the_bits_of_the_kernels_themselves(mode: str) -> None:
    plain, recorded = (
        _envs(time_limit=_SHORT, autoreset_mode=mode, graphs=graphs) for graphs in (False, True)
    )
    np.testing.assert_array_equal(*(as_numpy(envs.reset()[0]) for envs in (plain, recorded)))
    for step in range(15):
        results = [envs.step(_actions(envs, 0.1 * step)) for envs in (plain, recorded)]
        for found, expected in zip(*(result[:4] for result in results), strict=True):
            np.testing.assert_array_equal(as_numpy(found), as_numpy(expected))
    plain.close()
    recorded.close()


@pytest.mark.parametrize(("domain", "task", "kwargs"), _CONTINUED)
def test_a_batch_and_an_environment_on_the_cpu_continue_from_rows_of_a_device(
    domain: str, task: str, kwargs: dict[str, Any]
) -> None:
    envs = gpu.load_vector(domain, task, 4, device="cpu", seed=0, flat=False, **kwargs)
    envs.reset()
    actions = torch.full(envs.action_space.shape, 0.1)
    for _ in range(4):
        envs.step(actions)
    found, *_ = envs.step(actions)
    snapshot = envs.to_cpu([1, 3])
    assert list(snapshot.step_count) == [5, 5]
    batch = suite.load_batch(domain, task, 2, 1, environment_kwargs=kwargs)
    batch.restore(snapshot)
    now = batch.task.get_observation(batch.physics)
    for name, values in now.items():
        # The same state in float32 and in float64.
        np.testing.assert_allclose(as_numpy(found[name])[[1, 3]], values, rtol=1e-3, atol=1e-4)
    found, reward, *_ = envs.step(actions)
    expected = batch.step(as_numpy(actions)[:2])
    np.testing.assert_allclose(as_numpy(reward)[[1, 3]], expected.reward, atol=1e-4)
    np.testing.assert_array_equal(as_numpy(envs.batch.counter.steps)[[1, 3]], batch._counter.steps)
    single = suite.load(domain, task, environment_kwargs=kwargs)
    single.restore(envs.to_cpu([2]))
    assert single.is_running
    batch.reset()  # the rows' next episodes are the first ones of their seeds
    again = suite.load_batch(domain, task, 4, 1, seed=0, environment_kwargs=kwargs).reset()
    for name, values in batch.task.get_observation(batch.physics).items():
        np.testing.assert_array_equal(values, again.observation[name][[1, 3]])
    envs.close()
