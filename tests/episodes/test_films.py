"""Films from Python; tests of the command are in cli/test_record.py."""

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, Kept, collect, film, load
from limberjack.episodes.episode import Episode
from limberjack.episodes.films import DepartedError, _check_same, drawable, record
from limberjack.episodes.parquet import encode
from limberjack.rl.control import Environment
from limberjack.utils.files import Hold
from tests import plain_domain
from tests.rl import odd_environments as odd

from .collected import ARM, put

_SIZE: dict[str, Any] = {"height": 32, "width": 48}


pytestmark = pytest.mark.usefixtures("pictures")


class _Frames:
    """Takes the place of a film and keeps its frames."""

    made: "list[_Frames]"

    def __init__(self, path: Path, control_timestep: float, height: int, width: int) -> None:
        self.frames: list[np.ndarray] = []
        self.path = path
        self.made.append(self)

    def add_picture(self, draw: Callable[[], np.ndarray]) -> None:
        self.frames.append(draw())

    def finish(self) -> None:
        self.path.touch()

    def discard(self) -> None:
        pass


@pytest.fixture
def films(monkeypatch: pytest.MonkeyPatch) -> list[_Frames]:
    """The films that the test makes, which are not encoded."""
    monkeypatch.setattr(_Frames, "made", [], raising=False)
    monkeypatch.setattr("limberjack.episodes.films.Film", _Frames)
    return _Frames.made


def test_a_film_of_a_function_is_that_of_its_environment(
    films: list[_Frames], tmp_path: Path
) -> None:
    path = record(plain_domain.make, out=tmp_path / "film.mp4", seed=3, **_SIZE)
    assert path == tmp_path / "film.mp4"
    assert list(tmp_path.iterdir()) == [path]
    environment = plain_domain.make(3)
    environment.reset()
    (film,) = films
    assert len(film.frames) == 1 + 25
    for frame in film.frames:
        np.testing.assert_array_equal(frame, environment.physics.render(32, 48, camera_id=0))
        environment.step([0.0])


def test_rows_of_a_function_begin_with_their_own_seeds(
    films: list[_Frames], tmp_path: Path
) -> None:
    record(plain_domain.make, out=tmp_path / "film.mp4", seed=3, rows=4, seconds=0.04, **_SIZE)
    first = films[0].frames[0]
    assert len(films[0].frames) == 3
    for row, (top, left) in enumerate([(0, 0), (0, 24), (16, 0), (16, 24)]):
        environment = plain_domain.make(3 + row)
        environment.reset()
        picture = environment.physics.render(16, 24, camera_id=0)
        np.testing.assert_array_equal(first[top : top + 16, left : left + 24], picture)


@pytest.mark.parametrize(("seconds", "frames"), [(None, 26), (0.1, 6), (9.0, 26), (1e-30, 2)])
def test_seconds_cut_an_episode_short_and_do_not_lengthen_that_of_a_function(
    seconds: float | None, frames: int, films: list[_Frames], tmp_path: Path
) -> None:
    record(plain_domain.make, out=tmp_path / "film.gif", seconds=seconds, **_SIZE)
    assert len(films[0].frames) == frames


@pytest.mark.parametrize(("seconds", "frames"), [(0.025, 4), (1e-30, 2)])
def test_a_last_control_step_that_the_seconds_end_within_is_filmed(
    seconds: float, frames: int, films: list[_Frames], tmp_path: Path
) -> None:
    record("cartpole", "balance", out=tmp_path / "film.gif", seconds=seconds, **_SIZE)
    assert len(films[0].frames) == frames


def test_an_environment_without_a_time_limit_is_filmed_for_some_seconds_or_refused(
    films: list[_Frames], tmp_path: Path
) -> None:
    out = tmp_path / "film.mp4"
    with pytest.raises(ValueError, match="no time limit, so the film would never end: give its"):
        record(plain_domain.endless, out=out, **_SIZE)
    for rows in (1, 2):
        record(plain_domain.endless, out=out, seconds=0.1, rows=rows, **_SIZE)
    assert [len(film.frames) for film in films] == [6, 6]


def test_an_environment_that_is_made_again_is_drawn_with_room_and_colours(
    films: list[_Frames], tmp_path: Path
) -> None:
    made: list[Environment] = []

    def make(seed: int) -> Environment:
        made.append(odd.shifting(seed))  # which depends on more than its stream
        return made[-1]

    plain = drawable(make, 100, 10_000, visualize_reward=True)(3)
    assert isinstance(plain, Environment)
    buffer = plain.physics.model.vis.global_
    assert (buffer.offheight, buffer.offwidth) == (100, 3840)
    assert plain.task.visualize_reward
    record(make, out=tmp_path / "film.mp4", height=64, width=48, camera=-1)
    assert {frame.shape for frame in films[0].frames} == {(64, 48, 3)}
    assert len(made) > 2


def test_a_task_that_colours_nothing_is_refused_by_name() -> None:
    environment = plain_domain.make(0)
    environment._task = object()  # pyright: ignore[reportAttributeAccessIssue] (colours nothing)
    make = drawable(lambda seed: environment, 64, 64, visualize_reward=True)
    with pytest.raises(ValueError, match=r"task object colours nothing; expected .*base\.Task"):
        make(0)


@pytest.mark.parametrize("repeat", [None, 2])
def test_an_environment_repeats_actions_in_a_film_as_it_does_or_as_asked(
    repeat: int | None, films: list[_Frames], tmp_path: Path
) -> None:
    acted: list[float] = []

    def counting(observation: Any) -> np.ndarray:
        acted.append(float(observation["place"][0]))
        return np.array([1.0])

    record(_repeating, out=tmp_path / "a.gif", policy=counting, action_repeat=repeat, **_SIZE)
    assert len(films[0].frames) == 26
    assert len(acted) == -(-25 // (repeat or 3))


def _repeating(seed: int) -> Environment:
    return plain_domain.push(random=seed, environment_kwargs={"action_repeat": 3})


def test_progress_is_reported_before_the_first_step_and_after_each(
    films: list[_Frames], tmp_path: Path
) -> None:
    reported: list[tuple[int, int, float]] = []
    record(
        plain_domain.make,
        out=tmp_path / "film.mp4",
        seconds=0.06,
        on_progress=lambda *now: reported.append(now),
        **_SIZE,
    )
    assert [now[:2] for now in reported] == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert reported[0][2] == 0.0
    assert reported[-1][2] != 0.0


class _Turning:
    """A policy with a state."""

    def reset(self) -> None:
        self.steps = 0

    def act(self, observation: Any) -> np.ndarray:
        self.steps += 1
        return np.array([2.0 if self.steps < 3 else -2.0])


class _TurningBatch:
    """The same for batches."""

    def reset_batch(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        pass

    def act_batch(self, observations: Any) -> np.ndarray:
        return np.zeros((64, 1))


_ready, _ready_for_batches = _Turning(), _TurningBatch()


def test_a_policy_may_be_an_object_or_class(films: list[_Frames], tmp_path: Path) -> None:
    out = tmp_path / "film.mp4"
    for policy in (_Turning, _Turning(), lambda observation: np.array([2.0])):
        record(plain_domain.make, out=out, policy=policy, seconds=0.04, **_SIZE)
    record(plain_domain.make, out=out, policy=_Turning, seconds=0.04, rows=2, **_SIZE)
    frames = [film.frames for film in films]
    np.testing.assert_array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[0], frames[2])
    for policy in (_Turning(), f"{__name__}:_ready", f"{__name__}:_ready_for_batches"):
        with pytest.raises(
            ValueError, match="give its class, so that each row has an object of its own"
        ):
            record(plain_domain.make, out=out, policy=policy, rows=2, **_SIZE)


def test_a_film_is_written_where_it_was_asked_for_though_the_policy_moves(
    films: list[_Frames], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def moving(observation: Any) -> np.ndarray:
        os.chdir("/")
        return np.array([2.0])

    monkeypatch.chdir(tmp_path)
    record(plain_domain.make, out="film.mp4", policy=moving, seconds=0.02, **_SIZE)
    assert (tmp_path / "film.mp4").exists()


def _none(seed: int) -> Environment | None:
    return None


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"seed": True}, "seed is True; expected a whole number"),
        ({"seed": 2**32 - 1, "rows": 2}, "the last row's seed is 4294967296; expected below"),
        ({"rows": 0}, "rows is 0; expected a whole number of at least 1"),
        ({"seconds": float("nan")}, "seconds is nan; expected a positive number"),
        ({"task": "push"}, "task is 'push', but tests.plain_domain:make makes the environment"),
        ({"domain": _none}, "made a NoneType; expected a dm_env.Environment"),
        ({"domain": "humanoid"}, "task is None; expected the name of a task"),
        ({"policy": 3}, "is of type int; expected a function of an observation"),
    ],
)
def test_arguments_that_cannot_be_filmed_are_refused_and_leave_nothing(
    kwargs: dict[str, Any], message: str, tmp_path: Path
) -> None:
    what = {"domain": plain_domain.make, "out": tmp_path / "film.mp4", **_SIZE, **kwargs}
    with pytest.raises((TypeError, ValueError), match=message):
        record(**what)
    assert not list(tmp_path.iterdir())


def test_one_film_is_written_by_one_process_at_a_time(films: list[_Frames], tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    out = tmp_path / "film.mp4"
    with Hold(out):
        with pytest.raises(ValueError, match=f"another process writes to {out}: wait for it"):
            record(plain_domain.make, out=out, **_SIZE)
        record(plain_domain.make, out=tmp_path / "other.mp4", seconds=0.02, **_SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["other.mp4"]


@pytest.mark.parametrize("content", [b"hours of work", b"\x89PNG\r\n", b"\0" * 20])
def test_a_file_that_is_no_film_is_not_replaced(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"film\.mp4, and the file of that name is no film"):
        record(plain_domain.make, out=path, seconds=0.04, **_SIZE)
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_or_a_link_to_nothing_is_not_replaced(tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe.gif", tmp_path / "link.gif"
    os.mkfifo(pipe)
    link.symlink_to(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"pipe\.gif is a pipe; expected a regular file"):
        record(plain_domain.make, out=pipe, seconds=0.04, **_SIZE)
    with pytest.raises(FileNotFoundError, match=r"link\.gif"):
        record(plain_domain.make, out=link, seconds=0.04, **_SIZE)
    assert pipe.is_fifo()
    assert link.is_symlink()


def test_an_earlier_film_is_replaced(films: list[_Frames], tmp_path: Path) -> None:
    for name, beginning in (("a.mp4", b"\0\0\0\x20ftypisom"), ("b.gif", b"GIF89a"), ("c.gif", b"")):
        (tmp_path / name).write_bytes(beginning)
        record(plain_domain.make, out=tmp_path / name, seconds=0.04, **_SIZE)
    assert len(films) == 3


# Films of recorded episodes, which are encoded.

_VIEW: dict[str, Any] = {"height": 64, "width": 64, "camera": 0}


def test_states_and_seeds_give_the_same_film(arms: Dataset, tmp_path: Path) -> None:
    domain, task, seconds = ARM
    collect(domain, task, "random", [64], out=tmp_path / "bare", time_limit=seconds, kept=Kept())
    shown: list[tuple[int, int, float]] = []
    from_states = film(
        arms, 64, out=tmp_path / "states.gif", on_progress=lambda *s: shown.append(s), **_VIEW
    )
    from_seed = film(load(tmp_path / "bare"), 64, out=tmp_path / "seed.gif", **_VIEW)
    assert from_states.read_bytes() == from_seed.read_bytes()
    assert shown[-1] == (5, 5, arms.episode(64).total)


def test_a_film_of_other_rewards_than_the_recorded_ones_is_refused(
    pendulums: Dataset, tmp_path: Path
) -> None:
    episode = pendulums.episode(69)
    forged = dataclasses.replace(episode, rewards=episode.rewards + 1)
    name = "seeds-0000000069-0000000070.parquet"
    put(tmp_path, name, encode(pendulums.recipe, [forged]))
    with pytest.raises(ValueError, match=r"seed 69 has other rewards here, .* than in the dataset"):
        film(load(tmp_path, allow_gaps=True), 69, out=tmp_path / "film.gif", **_VIEW)
    assert [path.name for path in tmp_path.iterdir()] == ["episodes"]


def test_an_episode_that_ends_earlier_is_another_one_and_undefined_rewards_are_equal(
    pendulums: Dataset,
) -> None:
    whole = Episode(69, None, np.array([1.0, np.nan, 2.0]))
    _check_same(whole, whole, pendulums.recipe)
    early = Episode(69, None, whole.rewards[:2])
    with pytest.raises(DepartedError, match=r"nan in 2 steps, .* nan in 3: "):
        _check_same(early, whole, pendulums.recipe)


def test_an_episode_that_is_not_there_is_refused(arms: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no episode of seed 3; the first is 63"):
        film(arms, 3, out=tmp_path / "film.gif")
