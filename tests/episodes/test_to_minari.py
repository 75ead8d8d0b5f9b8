"""Datasets in Minari's format: `make test-minari`.

The slow test installs Limberjack and Minari with pip into a new environment.
"""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, Kept, Pixels, collect, load

from .collected import EVERYTHING

_REPOSITORY = Path(__file__).parents[2]
_LIMIT = 600  # seconds

# Opens the dataset, and steps the recovered environment with an episode's seed and actions.
_PROGRAM = """
import sys
import warnings
import minari
import numpy as np
warnings.filterwarnings("error", "Package|Installed")  # of a requirement that is not met
dataset = minari.load_dataset(sys.argv[1])
env = dataset.recover_environment()
for episode in dataset.iterate_episodes():
    (about,) = dataset.storage.get_episode_metadata([episode.id])
    observation, _ = env.reset(seed=about["seed"])
    for step, action in enumerate(episode.actions):
        observation, reward, terminated, truncated, _ = env.step(action)
        seen = episode.observations
        if isinstance(seen, dict):
            assert all(np.array_equal(observation[n], seen[n][step + 1]) for n in seen)
        else:
            assert np.array_equal(observation, seen[step + 1])
        assert reward == episode.rewards[step]
        assert terminated == episode.terminations[step]
        assert truncated == episode.truncations[step]
print(dataset.total_episodes, dataset.total_steps)
"""


@pytest.fixture
def to_minari() -> Any:
    """The function, where Minari is installed."""
    pytest.importorskip("minari", reason="needs the extra 'minari'")
    from limberjack.episodes.to_minari import to_minari

    return to_minari


def _stepped(root: Path, name: str, python: Path | str = sys.executable) -> str:
    """The output of the program in a process of its own."""
    variables = {**os.environ, "MINARI_DATASETS_PATH": str(root)}
    if python != sys.executable:
        variables.pop("PYTHONPATH", None)
    done = subprocess.run(
        [python, "-c", textwrap.dedent(_PROGRAM), name],
        env=variables,
        cwd=root,
        capture_output=True,
        text=True,
        timeout=_LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_recovered_environment_repeats_every_episode(
    arms: Dataset, to_minari: Any, tmp_path: Path
) -> None:
    name = to_minari(arms, tmp_path)
    assert name == "limberjack/manipulator-bring_ball/random-v0"
    assert _stepped(tmp_path, name) == "2 10"
    metadata = json.loads((tmp_path / name / "data" / "metadata.json").read_text())
    assert metadata["limberjack"] == arms.recipe.facts
    versions = arms.recipe.facts["versions"]
    assert metadata["requirements"] == [f"{n}=={versions[n]}" for n in ("limberjack", "mujoco")]


def test_flat_observations_of_float32_are_repeated_too(to_minari: Any, tmp_path: Path) -> None:
    collect("reacher", "easy", "random", range(2), out=tmp_path, kept=EVERYTHING, time_limit=0.1)
    assert _stepped(tmp_path, to_minari(load(tmp_path), tmp_path, "mine/reach-v3")) == "2 10"


def test_faults_are_recovered_and_pictures_are_left_out(to_minari: Any, tmp_path: Path) -> None:
    kept = Kept(pixels=Pixels(height=8, width=8, quality="fast"))
    world = {"faults": {"delay": {"observations": 2}, "noise": {"observations": 0.1}}}
    how = {"kept": kept, "world": world, "time_limit": 0.1}
    collect("reacher", "easy", "random", range(2), out=tmp_path, **how)
    assert _stepped(tmp_path, to_minari(load(tmp_path), tmp_path, "mine/late-v0")) == "2 10"


def test_an_earlier_conversion_is_replaced_and_another_dataset_is_not(
    arms: Dataset, pendulums: Dataset, to_minari: Any, tmp_path: Path
) -> None:
    for dataset in (arms, pendulums):
        to_minari(dataset, tmp_path, "mine-v0")
    metadata = tmp_path / "mine-v0" / "data" / "metadata.json"
    content = json.loads(metadata.read_text())
    assert content["total_episodes"] == 70
    del content["limberjack"]
    metadata.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"mine-v0 exists: remove it"):
        to_minari(arms, tmp_path, "mine-v0")
    assert [path.name for path in tmp_path.iterdir()] == ["mine-v0"]


@pytest.mark.parametrize("name", ["walk", "../walk-v0", "/walk-v0", "a b-v0", "walk-v"])
def test_what_is_no_id_is_refused(name: str, arms: Dataset, to_minari: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one such as 'mine/walk-v0'"):
        to_minari(arms, tmp_path / "root", name)
    assert not list(tmp_path.iterdir())


def test_a_damaged_file_leaves_nothing_behind(
    damaged: Path, to_minari: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    root = tmp_path_factory.mktemp("root")
    with pytest.raises(ValueError, match="is damaged"):
        to_minari(load(damaged), root, "mine-v0")
    assert list(root.iterdir()) == []


def test_the_episodes_have_their_actions_as_float64(
    arms: Dataset, to_minari: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import minari  # pyright: ignore[reportMissingImports]

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset = minari.load_dataset(to_minari(arms, tmp_path))
    for one, other in zip(arms, dataset.iterate_episodes(), strict=True):
        assert other.actions.dtype == np.float64
        np.testing.assert_array_equal(other.actions, one.actions)


@pytest.mark.slow
def test_a_new_environment_opens_a_dataset_and_steps(
    arms: Dataset, to_minari: Any, tmp_path: Path
) -> None:
    name = to_minari(arms, tmp_path)
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True, timeout=_LIMIT)
    python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, f"{_REPOSITORY}[minari]"], check=True, timeout=_LIMIT)
    assert _stepped(tmp_path, name, python) == "2 10"


def test_what_is_beside_an_earlier_conversion_is_not_removed(
    arms: Dataset, to_minari: Any, tmp_path: Path
) -> None:
    hidden = tmp_path / ".mine-v0"
    hidden.mkdir()
    (hidden / "notes").write_text("mine")
    to_minari(arms, tmp_path, "mine-v0")
    assert (hidden / "notes").read_text() == "mine"
    for notes in (tmp_path / "mine-v0" / "notes", tmp_path / "mine-v0" / "data" / "notes"):
        notes.write_text("mine")
        with pytest.raises(ValueError, match=r"mine-v0 exists: remove it"):
            to_minari(arms, tmp_path, "mine-v0")
        assert notes.read_text() == "mine"
        notes.unlink()
    to_minari(arms, tmp_path, "mine-v0")
