"""Recordings of episodes, and playing them again."""

import dataclasses
import platform
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.recording.episodes import Recording, record_episode, replay
from limberjack.report import Step
from tests import plain_domain
from tests.planner.planned import PLANNED
from tests.rollouts import run_episode


def _load(domain: str, task: str, seed: int = 3) -> Any:
    return suite.load(domain, task, task_kwargs={"random": seed, "time_limit": 0.2})


def _record(domain: str, task: str) -> Recording:
    env = _load(domain, task)
    random = np.random.default_rng(0)
    spec = env.action_spec()
    return record_episode(
        env, lambda: random.uniform(spec.minimum, spec.maximum), {"domain": domain, "task": task}
    )


@pytest.mark.parametrize(("domain", "task"), PLANNED)
def test_a_recording_is_played_again_bit_for_bit_from_its_file(
    domain: str, task: str, tmp_path: Path
) -> None:
    recording = _record(domain, task)
    recording.save(tmp_path / "episode.npz")
    read = Recording.load(tmp_path / "episode.npz")
    assert read.about == {"domain": domain, "task": task}
    for name in ("actions", "rewards", "states"):
        np.testing.assert_array_equal(getattr(read, name), getattr(recording, name))
    assert read.observations.keys() == recording.observations.keys()
    # An environment with another seed: the recording brings its own start.
    assert replay(read, _load(domain, task, seed=4)) is None


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"),
    reason="the file was recorded on x86_64, and other processors round differently",
)
def test_a_recording_from_before_the_planner_was_ordered_still_replays() -> None:
    """The file was written by `limberjack solve` on 2026-11-23, before `limberjack.recording`."""
    recording = Recording.load(Path(__file__).with_name("stack_2_of_0_1.npz"))
    assert recording.about["versions"]["limberjack"] == "0.1.0"
    env = suite.load("stacker", "stack_2", {"time_limit": recording.about["time_limit"]})
    assert replay(recording, env) is None


def test_what_is_recorded_is_what_a_plain_loop_sees() -> None:
    recording = _record("humanoid", "walk")
    env = _load("humanoid", "walk")
    time_step = env.reset()
    np.testing.assert_array_equal(
        recording.observations["velocity"][0], time_step.observation["velocity"]
    )
    for step, action in enumerate(recording.actions):
        time_step = env.step(action)
        assert time_step.reward == recording.rewards[step]
        for name, value in time_step.observation.items():
            np.testing.assert_array_equal(recording.observations[name][step + 1], value)
    assert time_step.last()
    assert len(recording.states) == len(recording.actions) + 1 == env.step_limit + 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("actions", "step 3: the state differs from the recorded one by up to"),
        ("rewards", "step 3: the reward differs from the recorded one by up to 0.5"),
        ("observations", "step 2: the observation 'velocity' differs"),
    ],
)
def test_a_recording_that_was_changed_is_found_out(changed: str, message: str) -> None:
    recording = _record("humanoid", "stand")
    values = getattr(recording, changed)
    values = values["velocity"] if changed == "observations" else values
    values[3] += 0.5
    difference = replay(recording, _load("humanoid", "stand"))
    assert difference is not None
    assert difference.startswith(message)


@pytest.mark.parametrize("index", [0, 3, -1])
@pytest.mark.parametrize("changed", ["states", "rewards", "velocity", "com_velocity"])
def test_a_difference_in_the_last_bit_is_one(changed: str, index: int) -> None:
    recording = _record("humanoid", "stand")
    values = recording.observations.get(changed, getattr(recording, changed, None))
    assert values is not None
    values[index] = np.nextafter(values[index], np.inf)
    difference = replay(recording, _load("humanoid", "stand"))
    assert difference is not None
    assert "differs from the recorded one by up to" in difference


def test_the_first_observation_is_compared_too() -> None:
    recording = _record("manipulator", "bring_ball")
    recording.observations["touch"][0] += 1
    difference = replay(recording, _load("manipulator", "bring_ball"))
    assert difference == "the start's observation 'touch' differs from the recorded one by up to 1"


def test_an_observation_that_was_taken_out_is_missed() -> None:
    recording = _record("humanoid", "stand")
    del recording.observations["velocity"]
    with pytest.raises(ValueError, match=r"'torso_vertical'\]; expected .* 'velocity'\]"):
        replay(recording, _load("humanoid", "stand"))


@pytest.mark.parametrize(
    ("time_limit", "message"),
    [
        (0.1, "step 3: the episode ends here; the recorded one has 8 steps"),
        (0.4, "step 7: the episode goes on; the recorded one has 8 steps"),
    ],
)
def test_an_episode_of_another_length_is_another_episode(time_limit: float, message: str) -> None:
    env = suite.load("humanoid", "stand", {"time_limit": time_limit})
    assert replay(_record("humanoid", "stand"), env) == message


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("actions", lambda actions: actions[:5], "'rewards' has length 8; expected 5, for 5 steps"),
        ("rewards", lambda rewards: rewards[:5], "'rewards' has length 5; expected 8, for 8 steps"),
        ("states", lambda states: states[:8], "'states' has length 8; expected 9, for 8 steps"),
        ("actions", lambda actions: actions[:0], "it has no step"),
        ("rewards", lambda rewards: rewards.astype(str), "'rewards' has dtype <U"),
        ("about", lambda about: [], "'about' is a list; expected a dictionary"),
    ],
)
def test_a_recording_with_parts_missing_is_refused(
    name: str, change: Any, message: str, tmp_path: Path
) -> None:
    recording = _record("humanoid", "stand")
    broken = dataclasses.replace(recording, **{name: change(getattr(recording, name))})
    broken.save(tmp_path / "episode.npz")
    with pytest.raises(ValueError, match=f"is no recording of an episode .*{message}"):
        Recording.load(tmp_path / "episode.npz")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("actions", lambda actions: actions > 0, "'actions' has dtype bool"),
        ("actions", lambda actions: actions * 1j, "'actions' has dtype complex128"),
        ("actions", lambda actions: actions * np.nan, "'actions' has infinities or NaN"),
        ("states", lambda states: states + np.inf, "'states' has infinities or NaN"),
        ("states", lambda states: states[0, 0], r"'states' has dtype float64 and shape \(\)"),
        ("rewards", lambda rewards: rewards[:, None], r"'rewards' has shape \(8, 1\)"),
        ("about", lambda about: "[" * 100_000, "'about' is a str"),
        ("start", lambda start: {"state": start["state"] * np.nan}, "'start.state' has infinities"),
    ],
)
def test_a_forged_recording_is_refused(
    name: str, change: Any, message: str, tmp_path: Path
) -> None:
    recording = _record("humanoid", "stand")
    forged = dataclasses.replace(recording, **{name: change(getattr(recording, name))})
    forged.save(tmp_path / "episode.npz")
    with pytest.raises(ValueError, match=f"is no recording of an episode .*{message}"):
        Recording.load(tmp_path / "episode.npz")


def test_a_recording_whose_json_is_nested_without_end_is_refused(tmp_path: Path) -> None:
    recording = _record("humanoid", "stand")
    recording.save(tmp_path / "episode.npz")
    with np.load(tmp_path / "episode.npz") as file:
        arrays = dict(file)
    for about in ("[" * 100_000, "{", "NaN", ""):
        np.savez(tmp_path / "episode.npz", **{**arrays, "about": np.array(about)})
        with pytest.raises(ValueError, match="is no recording of an episode"):
            Recording.load(tmp_path / "episode.npz")


def test_a_start_that_cannot_be_simulated_is_one_sentence() -> None:
    recording = _record("humanoid", "stand")
    recording.start["state"][...] = 1e300
    assert re.search("cannot be simulated|differs|diverges", _outcome(recording))


def _outcome(recording: Recording) -> str:
    """The difference or error reported for a recording that does not replay equally."""
    try:
        return replay(recording, _load("humanoid", "stand")) or ""
    except ValueError as error:
        return str(error)


def test_observations_that_are_true_or_false_are_compared() -> None:
    def load() -> Any:
        return plain_domain.make(3)

    recording = record_episode(load(), lambda: np.ones(1), {})
    assert recording.observations["fast"].dtype == bool
    assert replay(recording, load()) is None
    recording.observations["fast"][2] ^= True
    assert replay(recording, load()) == (
        "step 1: the observation 'fast' differs from the recorded one by up to 1"
    )


def test_what_a_task_shows_of_live_memory_is_recorded_as_it_was() -> None:
    recording = record_episode(plain_domain.make(3), lambda: np.ones(1), {})
    environment = plain_domain.make(3)
    places = [environment.reset().observation["place"].copy()]
    places += [environment.step([1.0]).observation["place"].copy() for _ in range(25)]
    np.testing.assert_array_equal(recording.observations["place"], places)


def test_recording_an_episode_is_running_it() -> None:
    seen: list[Step] = []
    recording = record_episode(_load("humanoid", "walk"), lambda: np.zeros(21), {}, seen.append)
    episode = run_episode(_load("humanoid", "walk"), policies.zero, 3)
    np.testing.assert_array_equal(recording.rewards, episode.rewards)
    assert [step.number for step in seen] == list(range(9))


def test_a_recording_of_another_task_is_refused() -> None:
    with pytest.raises(ValueError, match="it is of another task or model than the environment"):
        replay(_record("manipulator", "bring_ball"), _load("stacker", "stack_4"))


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.npz"
    text.write_text("not a recording")
    other = tmp_path / "other.npz"
    np.savez(other, actions=np.zeros(3))
    array = tmp_path / "array.npz"
    with array.open("wb") as file:
        np.save(file, np.zeros(3))
    damaged = tmp_path / "damaged.npz"
    _record("humanoid", "stand").save(damaged)
    content = bytearray(damaged.read_bytes())
    content[100] ^= 0xFF
    damaged.write_bytes(content)
    for path in (text, other, array, damaged):
        with pytest.raises(ValueError, match=f"{path.name} is no recording of an episode"):
            Recording.load(path)
    with pytest.raises(FileNotFoundError):
        Recording.load(tmp_path / "none.npz")


def test_a_recording_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "episode.npz"
    recording = _record("stacker", "stack_2")
    recording.save(path)
    broken = dataclasses.replace(recording, about={"task": {1, 2}})  # sets are not JSON
    with pytest.raises(TypeError):
        broken.save(path)
    assert Recording.load(path).about["domain"] == "stacker"
    assert [file.name for file in tmp_path.iterdir()] == ["episode.npz"]
