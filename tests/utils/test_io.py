"""Tests of limberjack.utils.io."""

import os
from pathlib import Path

import pytest

from limberjack.utils import io

TEXT = "<mujoco model='größer'/>"


@pytest.fixture
def resource(tmp_path: Path) -> str:
    path = tmp_path / "model.xml"
    path.write_bytes(TEXT.encode())
    return str(path)


def test_a_resource_is_read_as_bytes_or_as_text(resource: str) -> None:
    assert io.GetResource(resource) == TEXT.encode()
    assert io.GetResource(resource, "r") == TEXT
    assert io.GetResource(Path(resource), mode="rb") == TEXT.encode()


def test_the_filename_of_a_resource_is_its_name(resource: str) -> None:
    assert io.GetResourceFilename(resource) == resource
    assert io.GetResourceFilename(resource, mode="r") == resource


def test_a_resource_opens_as_a_file(resource: str) -> None:
    with io.GetResourceAsFile(resource) as file:
        assert file.read() == TEXT
    with io.GetResourceAsFile(resource, "rb") as file:
        assert file.read() == TEXT.encode()
    with io.GetResourceAsFile(resource, "r", encoding="latin-1") as file:
        assert file.read() != TEXT


def test_walking_gives_what_os_walk_gives(resource: str) -> None:
    folder = os.path.dirname(resource)
    os.mkdir(os.path.join(folder, "below"))
    assert list(io.WalkResources(folder)) == list(os.walk(folder))


def test_a_missing_resource_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nothing\.xml"):
        io.GetResource(str(tmp_path / "nothing.xml"))


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_what_may_never_end_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("/dev/zero", tmp_path / "pipe"):
        with pytest.raises(ValueError, match="expected a regular file"):
            io.GetResource(name)
