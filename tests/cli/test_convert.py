"""`limberjack convert`."""

import sys
from pathlib import Path

import pytest

from limberjack.data import collect

from .conftest import invoke


def _collected(folder: Path) -> Path:
    collect("pendulum", "swingup", "zero", range(2), out=folder, time_limit=0.1)
    return folder


def test_the_place_and_the_id_are_printed(tmp_path: Path) -> None:
    pytest.importorskip("minari", reason="needs the extra 'minari'")
    folder = _collected(tmp_path / "zero")
    result = invoke("convert", str(folder), "--to", "minari")
    name = "limberjack/pendulum-swingup/zero-v0"
    expected = f'MINARI_DATASETS_PATH={folder}/minari: minari.load_dataset("{name}")\n'
    assert (result.exit_code, result.stdout) == (0, expected)
    arguments = ["--to", "minari", "--out", str(tmp_path / "root"), "--id", "mine-v1"]
    assert invoke("convert", str(folder), *arguments).exit_code == 0
    assert (tmp_path / "root" / "mine-v1" / "data" / "metadata.json").exists()


def test_without_minari_the_packages_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    monkeypatch.delitem(sys.modules, "limberjack.episodes.to_minari", raising=False)
    result = invoke("convert", str(_collected(tmp_path)), "--to", "minari")
    assert result.exit_code == 1
    assert result.stderr.endswith("'minari': pip install minari pillow pyarrow\n")


def test_another_format_is_refused(tmp_path: Path) -> None:
    assert invoke("convert", str(tmp_path), "--to", "hdf5").exit_code == 2
