"""The models of dm_control, compiled once for several tests."""

import copy
import functools
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import pytest

__all__: list[str] = []

# Bytes of a model's files, from which on compiling it takes 0.6 s, and reading the result 0.1 s.
_LARGE = 2**20
# The modules in which such models have the same source, with a small sky.
_SHARING = {f"test_{name}.py" for name in ("batches", "domains", "episodes", "physics", "variants")}


@pytest.fixture(scope="session")
def _large_models(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder for compiled models, shared by all processes of pytest-xdist.

    The first one to end removes it; the others compile what they need after that.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "large_models"
    folder.mkdir(exist_ok=True)
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def compiled_once(request: pytest.FixtureRequest, _large_models: Path) -> Iterator[None]:
    """dm_control takes a copy, bit for bit the same, of the last model if the source is the same.

    Otherwise compilation would take a third of the time of short tests. The tests of a task run one
    after the other, and use one model; several of dm_control's dog would take 70 MB each, which
    other modules read from a file.
    """
    from .oracle import theirs  # skips where dm_control is not installed

    core: Any = theirs("mujoco.wrapper.core")
    compile_anew = core._get_model_ptr_from_xml
    last: dict[bytes, mujoco.MjModel] = {}
    is_sharing = request.path.name in _SHARING

    def copy_of(xml_path: Any = None, xml_string: Any = None, assets: Any = None) -> Any:
        if xml_path is not None:
            return compile_anew(xml_path=xml_path)
        source = _digest(xml_string, assets or {})
        if source not in last:
            last.clear()
            is_stored = is_sharing and sum(map(len, (assets or {}).values())) > _LARGE
            make = functools.partial(compile_anew, xml_string=xml_string, assets=assets)
            last[source] = _stored(_large_models, source, make) if is_stored else make()
        return copy.copy(last[source])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core, "_get_model_ptr_from_xml", copy_of)
        yield


def _stored(folder: Path, source: bytes, make: Callable[[], mujoco.MjModel]) -> mujoco.MjModel:
    """The model of that source: from its file, or made and stored."""
    path = folder / f"{hashlib.sha256(source).hexdigest()}.mjb"
    if path.exists():
        return mujoco.MjModel.from_binary_path(str(path))
    model, part = make(), path.with_suffix(f".{os.getpid()}.mjb")
    if folder.exists():
        mujoco.mj_saveModel(model, str(part))
        part.replace(path)  # whole, for other processes
    return model


def _digest(xml_string: str | bytes, assets: dict[str, bytes]) -> bytes:
    """A digest of a source; the files of dm_control's dog are 20 MB."""
    parts = [xml_string, *(part for file in assets.items() for part in file)]
    content = (part.encode() if isinstance(part, str) else part for part in parts)
    return b"".join(hashlib.sha256(part).digest() for part in content)
