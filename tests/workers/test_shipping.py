"""Policies on their way to a worker."""

import concurrent.futures
import importlib
import linecache
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from limberjack import policies, suite
from limberjack.policies import Actor, PolicyError
from limberjack.utils.sources import Source
from limberjack.workers.shipping import Shipped, _import_shipped, ship, unpack
from tests.policies import saved_models

from . import playing
from .playing import TASK


def _unpacked(shipped: Any) -> Actor:
    return unpack(pickle.loads(pickle.dumps(shipped)), suite.load(*TASK), None)


@pytest.mark.parametrize("name", ["zero", "random", "tests.workers.playing:BatchedMemory"])
def test_a_policy_has_the_same_hash_on_both_sides(name: str) -> None:
    expected = policies.find(name, suite.load(*TASK))
    found = _unpacked(ship(name))
    assert (found.name, found.sha256) == (name, expected.sha256)


def test_a_function_or_a_class_is_shipped_by_its_name() -> None:
    assert ship(playing.damped).name == "tests.workers.playing:damped"
    assert ship(playing.Memory).name == "tests.workers.playing:Memory"


def test_objects_and_the_main_program_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PolicyError, match="is an object that other processes"):
        ship(playing.Memory())
    monkeypatch.setattr(sys.modules["__main__"], "act", playing.damped, raising=False)
    with pytest.raises(PolicyError, match="main program or a notebook"):
        ship("__main__:act")
    with pytest.raises(PolicyError, match="there is no module 'nowhere'"):
        ship("nowhere:act")


def test_each_thread_has_an_object_of_its_own() -> None:
    environment, shipped = suite.load(*TASK), ship("tests.workers.playing:memory")
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        found = executor.submit(unpack, shipped, environment, None).result()
        assert found.plays_alone
        observation = environment.reset().observation
        found.begin_alone(environment, 0)(observation)
        assert not hasattr(playing.memory, "steps")
        message = "'tests.workers.playing:locked' is an object that cannot be copied"
        with pytest.raises(PolicyError, match=message):
            executor.submit(
                unpack, ship("tests.workers.playing:locked"), environment, None
            ).result()
    assert unpack(ship("tests.workers.playing:locked"), environment, None).plays_alone


def test_a_process_without_the_module_imports_what_was_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "shipped_policies"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "weights.py").write_text("GAIN = 0.25\n")
    (package / "acting.py").write_text(
        "from shipped_policies.weights import GAIN\n\n\ndef act(observation):\n"
        "    return GAIN * observation['velocity']\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    name = "shipped_policies.acting:act"
    sha256 = policies.find(name, suite.load(*TASK)).sha256
    (tmp_path / "shipped.pickle").write_bytes(pickle.dumps(ship(name)))
    program = """
import pickle, sys
from limberjack import suite
from limberjack.workers.shipping import unpack
shipped = pickle.loads(open(sys.argv[1], "rb").read())
print(unpack(shipped, suite.load("pendulum", "swingup"), None).sha256)
import shipped_policies.acting
print(shipped_policies.acting.act({"velocity": 2.0}), shipped_policies.acting.__spec__.origin)
"""
    folders = os.pathsep.join(folder for folder in sys.path if folder != str(tmp_path))
    done = subprocess.run(
        [sys.executable, "-P", "-c", program, str(tmp_path / "shipped.pickle")],
        env={**os.environ, "PYTHONPATH": folders},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout.splitlines() == [sha256, "0.5 shipped"], done.stderr


def test_a_saved_model_is_shipped_as_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    humanoid = suite.load("humanoid", "stand")
    expected = policies.find(name, humanoid)
    shipped = ship(name)
    Path(name.removeprefix("sb3:")).unlink()
    found = unpack(shipped, humanoid, None)
    assert (found.name, found.sha256) == (name, expected.sha256)
    with pytest.raises(PolicyError, match="No such file"):
        ship(name)


@pytest.fixture
def own_imports() -> Iterator[None]:
    modules, finders = set(sys.modules), list(sys.meta_path)
    yield
    sys.meta_path[:] = finders
    for name in set(sys.modules) - modules:
        del sys.modules[name]


@pytest.mark.usefixtures("own_imports")
def test_a_module_is_imported_without_a_file() -> None:
    _import_shipped("shipped_alone", Source("", {"shipped_alone.py": b"x = 'h\xc3\xa9'\n"}))
    module = importlib.import_module("shipped_alone")
    assert module.x == "h\u00e9"
    assert not hasattr(module, "__file__")


@pytest.mark.usefixtures("own_imports")
def test_a_package_is_imported_with_its_parts() -> None:
    files = {
        "__init__.py": b"from shipped_package import late\n",
        "late.py": b"from .networks import small\ny = small.x\n",
        "networks/small.py": b"x = 3\n",
    }
    _import_shipped("shipped_package.late", Source("shipped_package", files))
    assert importlib.import_module("shipped_package.late").y == 3


@pytest.mark.usefixtures("own_imports")
def test_a_package_within_others_is_imported() -> None:
    _import_shipped("a_root.inner.act", Source("a_root.inner", {"act.py": b"x = 3\n"}))
    assert importlib.import_module("a_root.inner.act").x == 3


@pytest.mark.usefixtures("own_imports")
@pytest.mark.parametrize("is_here", [False, True])
def test_a_package_that_is_missing_is_named_and_leaves_no_finder(
    is_here: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Source("", {"needy.py": b"import not_installed_anywhere\n"})
    if is_here:
        (tmp_path / "needy.py").write_bytes(source.files["needy.py"])
        monkeypatch.syspath_prepend(tmp_path)
    before = list(sys.meta_path)
    with pytest.raises(ModuleNotFoundError, match="not_installed_anywhere"):
        unpack(Shipped("needy:act", source), suite.load(*TASK), None)
    assert sys.meta_path == before


@pytest.mark.usefixtures("own_imports")
def test_a_traceback_shows_the_source() -> None:
    _import_shipped("shipped_wrong", Source("", {"shipped_wrong.py": b"def f():\n    1 / 0\n"}))
    module = importlib.import_module("shipped_wrong")
    linecache.lazycache("<shipped>", vars(module))
    with pytest.raises(ZeroDivisionError):
        module.f()
