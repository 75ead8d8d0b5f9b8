"""`limberjack collect`."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from limberjack.data import Pixels, collect, load
from limberjack.episodes import illustrating
from limberjack.mujoco.rendering import RenderingError
from tests.episodes.collected import PENDULUM, hashes, of_64, whole_hashes
from tests.workers.killing import children, is_alive, shared_memory, wait_for

from .conftest import call, invoke

_PENDULUM = ["collect", "pendulum", "swingup", "--time-limit", "0.2", "--threads", "1"]
_IN_64 = ["--file-mb", str(of_64(PENDULUM))]  # files of 64 episodes

# Interrupts the process as the second file is played.
_INTERRUPTING = """
import os, signal
import numpy as np

class Interrupting:
    def reset_batch(self, rows, seeds):
        if 70 in seeds:
            os.kill(os.getpid(), signal.{signal})

    def act_batch(self, observations):
        return np.zeros((64, 1))

class NotANumber(Interrupting):
    def reset_batch(self, rows, seeds):
        self.is_bad = 70 in seeds

    def act_batch(self, observations):
        return np.full((64, 1), np.nan if self.is_bad else 0.0)
"""


def test_the_figures_of_the_dataset_are_printed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = invoke(*_PENDULUM, "--policy", "random", "--seeds", "3:7", "--out", str(out))
    assert result.exit_code == 0, result.stderr
    assert re.search(r"^ random +4 +0\.0 ", result.stdout, re.MULTILINE)
    assert "pendulum swingup: 4 episodes of seeds 3 to 6, 40 steps of 0.02 s" in result.stdout
    assert "in 1 files" in result.stdout
    assert result.stderr == ""
    collect("pendulum", "swingup", "random", range(3, 7), out=tmp_path / "py", time_limit=0.2)
    assert hashes(out) == hashes(tmp_path / "py")


def test_a_set_has_a_dataset_for_each_task(tmp_path: Path) -> None:
    options = ["--time-limit", "0.2", "--threads", "1", "--episodes", "2", "--out", str(tmp_path)]
    result = invoke("collect", "--set", "pendulum:swingup,point_mass:easy", *options)
    assert result.exit_code == 0, result.stderr
    assert "pendulum swingup: 2 episodes" in result.stdout
    assert "point_mass easy: 2 episodes" in result.stdout
    assert len(load(tmp_path / "point_mass-easy")) == 2


def test_a_mistake_in_the_second_task_of_a_set_is_one_line_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "point_mass-easy").mkdir()
    (tmp_path / "point_mass-easy" / "dataset.json").write_text("mine")
    options = ["--time-limit", "0.2", "--threads", "1", "--episodes", "2", "--out", str(tmp_path)]
    result = invoke("collect", "--set", "pendulum:swingup,point_mass:easy", *options)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"limberjack: point_mass easy: {tmp_path}/point_mass-easy/data")
    assert "; 2 of 4 episodes are in " in result.stderr
    assert result.stderr.count("\n") == 1
    assert len(load(tmp_path / "pendulum-swingup")) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["pendulum", "swingup", "--set", "dmc28"], "got DOMAIN beside --set"),
        (["--set", "dmc28", "--env", "mine:make"], "got --env beside --set"),
        (["--set", "dmc27"], "no set of tasks 'dmc27'"),
        (["--set", "pendulum:swing"], "'swing' does not exist in domain 'pendulum'"),
    ],
)
def test_a_set_that_cannot_be_is_refused(options: list[str], message: str, tmp_path: Path) -> None:
    result = invoke("collect", *options, "--out", str(tmp_path / "set"))
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
    assert not (tmp_path / "set").exists()


def test_without_opengl_a_dataset_is_complete_and_one_line_says_that_it_has_no_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*arguments: object) -> None:
        raise RenderingError("OpenGL is not available")

    monkeypatch.setattr(illustrating, "_first_picture", failing)
    monkeypatch.setattr(illustrating, "_film", failing)
    out = tmp_path / "out"
    result = invoke(*_PENDULUM, "--seeds", "0:1", "--out", str(out), "--film")
    assert result.exit_code == 0
    assert result.stderr == "".join(
        f"limberjack: {out} is complete, without median-0000000000.{ending}: OpenGL is not "
        "available\n"
        for ending in ("png", "mp4")
    )
    assert "There is no picture" in (out / "README.md").read_text()
    assert len(load(out)) == 1


def test_a_damaged_file_is_one_line_that_says_what_to_do_whichever_it_is(tmp_path: Path) -> None:
    collecting = [*_PENDULUM, *_IN_64, "--seeds", "0:70", "--out", str(tmp_path)]
    assert invoke(*collecting).exit_code == 0
    for path in sorted(tmp_path.glob("episodes/*")):
        content = path.read_bytes()
        path.write_bytes(content[:-50])
        result = invoke(*collecting)
        assert result.exit_code in (1, 2)
        assert result.stderr.startswith(f"limberjack: {path} is damaged")
        assert result.stderr.count("\n") == 1
        assert "continues" not in result.stderr
        path.write_bytes(content)
    assert invoke(*collecting).exit_code == 0


def test_a_damaged_file_is_made_again_and_one_line_says_so(tmp_path: Path) -> None:
    command = [*_PENDULUM, "--seeds", "0:2", "--out", str(tmp_path)]
    assert invoke(*command).exit_code == 0
    before = hashes(tmp_path)
    (path,) = (tmp_path / "episodes").iterdir()
    path.write_bytes(b"PAR1")
    refused = invoke(*command)
    assert refused.exit_code == 2
    assert "repeat the command that collected it with --repair, which makes it" in refused.stderr
    repaired = invoke(*command, "--repair")
    assert repaired.exit_code == 0
    moved = tmp_path / "damaged" / path.name
    assert repaired.stderr == (
        f"limberjack: {path} is damaged: it was moved to {moved}, and is made again\n"
    )
    assert hashes(tmp_path) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "memory://walk", "--format", "minari"], "--format minari needs a folder"),
        (["--out", "nowhere://walk"], "nowhere://walk is no URL that fsspec reads"),
        (["--out", "out", "--repair", "--shard", "1/2"], "repair the dataset without a shard"),
    ],
)
def test_a_place_that_cannot_be_is_refused_in_one_line(arguments: list[str], message: str) -> None:
    result = invoke(*_PENDULUM, *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_the_options_choose_what_is_kept(tmp_path: Path) -> None:
    options = ["--seeds", "0:1", "--states", "--float32", "--flat", "--out", str(tmp_path)]
    assert invoke(*_PENDULUM, *options).exit_code == 0
    (episode,) = load(tmp_path)
    assert episode.states is not None
    assert {n: (v.dtype.name, v.shape) for n, v in episode.observations.items()} == {
        "observations": ("float32", (11, 3))
    }


def test_shards_share_a_folder_until_the_command_without_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds = ["--seeds", "60:130", "--out", str(tmp_path), *_IN_64]
    command = ["limberjack", *_PENDULUM, *seeds]
    monkeypatch.setattr(sys, "argv", [*command, "--shard", "2/2"])
    first = invoke(*_PENDULUM, *seeds, "--shard", "1/2")
    assert first.stdout == f"shard 1/2 is complete in {tmp_path}\n"
    assert invoke(*_PENDULUM, *seeds, "--shard", "2/2").exit_code == 0
    before = hashes(tmp_path)
    assert len(before) == 3
    refused = invoke("info", str(tmp_path))
    assert refused.exit_code == 2
    assert f"to finish the dataset, repeat `{' '.join(command)}`; load" in refused.stderr
    assert invoke(*_PENDULUM, *seeds).exit_code == 0
    assert hashes(tmp_path) == before


def test_a_file_has_as_many_episodes_as_were_asked_for(tmp_path: Path) -> None:
    arguments = ["--seeds", "0:5", "--out", str(tmp_path), "--file-mb", "0.000001"]
    assert invoke(*_PENDULUM, *arguments).exit_code == 0
    assert len(hashes(tmp_path)) == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "5:5"], "--seeds is 5:5, which holds no seed"),
        (["--policy", "radnom"], "Did you mean 'random'?"),
        (["--time-limit", "0"], "time_limit is 0.0; expected a positive number"),
        (["--time-limit", "inf"], "pendulum swingup has no time limit, so an episode might never"),
        (["--out", "a_file"], "a_file"),
        (["--out", "damaged"], "is damaged or no file of a dataset"),
        (["--shard", "3/2"], "--shard is '3/2'"),
        (["--file-mb", "0"], "file_mb is 0.0; expected a positive number of megabytes"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a_file").write_text("")
    Path("damaged/episodes").mkdir(parents=True)
    Path("damaged/episodes/seeds-0000000000-0000000064.parquet").write_bytes(b"PAR1")
    result = invoke(*_PENDULUM, "--out", "out", *arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert message in result.stderr
    assert result.stderr.startswith("limberjack: ")
    assert result.stderr.count("\n") == 1


def test_another_dataset_in_the_folder_is_refused_by_name(tmp_path: Path) -> None:
    assert invoke(*_PENDULUM, "--seeds", "0:1", "--out", str(tmp_path)).exit_code == 0
    before = hashes(tmp_path)
    result = invoke(*_PENDULUM, "--seeds", "0:2", "--flat", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "flat is False and True: choose another folder" in result.stderr
    assert hashes(tmp_path) == before


@pytest.mark.usefixtures("pictures")
def test_pictures_are_kept_from_a_camera(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ["--seeds", "0:1", "--out", str(out)]
    result = invoke(*_PENDULUM, *options, "--camera", "lookat")
    assert result.exit_code == 2
    expected = "--camera is lookat, and no pictures are kept: add --pixels 84"
    assert result.stderr == f"limberjack: {expected}\n"
    assert not out.exists()
    assert invoke(*_PENDULUM, *options, "--pixels", "8", "--camera", "lookat").exit_code == 0
    dataset = load(out)
    assert dataset[0].observations["pixels"].shape == (11, 8, 8, 3)
    assert dataset.recipe.kept.pixels == Pixels("lookat", 8, 8)
    result = invoke(*_PENDULUM, *options, "--pixels", "8")
    assert result.exit_code == 2
    assert "pixels.camera is 'lookat' and 0: choose another folder" in result.stderr


@pytest.mark.parametrize(
    ("name", "status"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGKILL", -signal.SIGKILL)]
)
def test_an_interrupted_collection_keeps_its_files_and_continues(
    name: str, status: int, tmp_path: Path
) -> None:
    module = tmp_path / "my_policies.py"
    module.write_text(_INTERRUPTING.format(signal=name))
    policy = ["--policy", "my_policies:Interrupting", "--seeds", "0:130", "--out", "out", *_IN_64]
    done = call(*_PENDULUM, *policy, directory=tmp_path)
    assert done.returncode == status
    if status > 0:
        expected = "64 of 130 episodes are in out: the same command continues from there"
        assert done.stderr == f"limberjack: interrupted: {expected}\n"
    assert set(hashes(tmp_path / "out")) <= {"seeds-0000000000-0000000064.parquet"}


def test_a_policys_failure_is_one_line_with_what_is_kept(tmp_path: Path) -> None:
    (tmp_path / "my_policies.py").write_text(_INTERRUPTING.format(signal="SIGINT"))
    policy = ["--policy", "my_policies:NotANumber", "--seeds", "0:130", "--out", "out", *_IN_64]
    done = call(*_PENDULUM, *policy, directory=tmp_path)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "step 0 of the episode with seed 64: returned nan" in done.stderr
    assert "; 64 of 130 episodes are in out: the same command continues" in done.stderr
    assert list(hashes(tmp_path / "out")) == ["seeds-0000000000-0000000064.parquet"]


def test_a_full_disk_is_one_line_and_nothing_is_half_written(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="no limits of files on this system")
    program = (
        "import signal, sys\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "from limberjack.cli import main\nsys.argv = ['limberjack', *sys.argv[1:]]\nmain()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *_PENDULUM, *_IN_64, "--seeds", "0:70", "--out", "out"],
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    file = tmp_path / "out" / "episodes" / "seeds-0000000000-0000000064.parquet"
    assert f"File too large: '{file}'" in done.stderr
    assert done.stderr.endswith(
        "; 0 of 70 episodes are in out: the same command continues from there\n"
    )
    left = sorted(path.name for path in (tmp_path / "out").rglob("*"))
    assert left == ["episodes", "parts", "run.json"]


def _begin(out: Path, home: Path) -> "subprocess.Popen[str]":
    """A slow collection with two workers."""
    inherited = {name: value for name, value in os.environ.items() if "COLOR" not in name}
    folders = {"PYTHONPATH": os.pathsep.join(sys.path), "HOME": str(home)}
    policy = ["--policy", "tests.workers.playing:Deadly", "--seeds", "60:200", *_IN_64]
    return subprocess.Popen(
        [sys.executable, "-m", "limberjack", *_PENDULUM, *policy, "--workers", "2", "--out", out],
        env=inherited | folders | {"SLOW": "0.05"},
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
def test_drivers_that_are_ended_leave_nothing_and_their_files_are_continued(
    tmp_path: Path,
) -> None:
    out, home = tmp_path / "out", tmp_path / "home"
    home.mkdir()
    seeds = ["--policy", "tests.workers.playing:Deadly", "--seeds", "60:200", *_IN_64, "--out"]
    for number, status, files in ((signal.SIGTERM, 143, 1), (signal.SIGKILL, -9, 2)):
        driver = _begin(out, home)
        wait_for(lambda driver=driver: len(children(driver.pid)) == 2)
        workers = children(driver.pid)
        wait_for(lambda files=files: len(hashes(out)) >= files)
        second = invoke(*_PENDULUM, *seeds, str(out))
        assert (second.exit_code, second.stderr.count("\n")) == (2, 1)
        assert f"another process writes to {out}" in second.stderr
        assert not [line for one in (driver.pid, *workers) for line in shared_memory(one)]
        driver.send_signal(number)
        _, printed = driver.communicate(timeout=300)
        assert driver.returncode == status, printed
        wait_for(lambda workers=workers: not any(map(is_alive, workers)))
        if number == signal.SIGTERM:
            assert re.fullmatch(
                r"limberjack: interrupted: \d+ of 140 episodes are in .*: the same command "
                r"continues from there\n",
                printed,
            )
    assert list(home.iterdir()) == []
    assert invoke(*_PENDULUM, *seeds, str(out)).exit_code == 0
    assert invoke(*_PENDULUM, *seeds, str(tmp_path / "one")).exit_code == 0
    assert whole_hashes(out) == whole_hashes(tmp_path / "one")


def test_without_its_extra_the_command_names_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    monkeypatch.delitem(sys.modules, "limberjack.episodes.to_minari", raising=False)
    out = tmp_path / "out"
    result = invoke(*_PENDULUM, "--seeds", "0:1", "--out", str(out), "--format", "minari")
    assert result.exit_code == 1
    expected = (
        "limberjack collect needs the extra 'minari': pip install fsspec minari pillow pyarrow"
    )
    assert result.stderr == f"limberjack: {expected}\n"
    assert not out.exists()


def test_episodes_of_a_function_have_no_minari_dataset_and_are_not_played(tmp_path: Path) -> None:
    where = ["--env", "tests.plain_domain:make", "--out", str(tmp_path / "out")]
    result = invoke("collect", *where, "--format", "minari")
    assert result.exit_code == 2
    assert "got --env tests.plain_domain:make and --format minari" in result.stderr
    assert not (tmp_path / "out").exists()


def test_format_minari_writes_both(tmp_path: Path) -> None:
    pytest.importorskip("minari", reason="needs the extra 'minari'")
    options = ["--seeds", "0:2", "--out", str(tmp_path), "--format", "minari"]
    for _ in range(2):
        assert invoke(*_PENDULUM, *options).exit_code == 0
    assert (tmp_path / "minari/limberjack/pendulum-swingup/zero-v0/data/metadata.json").exists()
    assert len(load(tmp_path)) == 2
