"""The errors that all commands on datasets report alike."""

import io
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import typer

from limberjack.cli.datasets import reading_reported
from limberjack.data import collect

from .conftest import invoke


def _with_another_byte(content: bytes) -> bytes:
    changed = bytearray(content)
    changed[len(content) // 3] ^= 1
    return bytes(changed)


def _as_a_pickle(content: bytes) -> bytes:
    return b"\x80\x04cos\nsystem\n(X\x04\x00\x00\x00exittR."


def _with_a_forged_recipe(content: bytes) -> bytes:
    table = pq.read_table(io.BytesIO(content))
    recipe = table.schema.metadata[b"limberjack"].replace(b'"int64",[]', b'"int64",{}')
    file = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({b"limberjack": recipe}), file)
    return file.getvalue()


@pytest.mark.parametrize(
    "command",
    [["info"], ["replay"], ["record", "--out", "film.gif", "--from"]],
)
def test_a_folder_without_a_dataset_is_one_line_and_status_2(
    command: list[str], tmp_path: Path
) -> None:
    result = invoke(*command, str(tmp_path))
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert f"{tmp_path} has no complete file of a dataset" in result.stderr


@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["replay"],
        ["record", "--out", "film.gif", "--from"],
        ["collect", "pendulum", "swingup", "--time-limit", "0.1", "--seeds", "0:2", "--out"],
    ],
)
@pytest.mark.parametrize("forge", [_with_another_byte, _as_a_pickle, _with_a_forged_recipe])
def test_a_forged_file_is_one_line_and_status_2(
    forge: Callable[[bytes], bytes],
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data"
    collect("pendulum", "swingup", "zero", range(2), out=folder, time_limit=0.1)
    (path,) = folder.glob("seeds-*")
    path.write_bytes(forge(path.read_bytes()))
    result = invoke(*command, str(folder))
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith(f"limberjack: {path} is damaged or no file of a dataset (")
    assert result.stderr.count("\n") == 1
    assert not Path("film.gif").exists()


def test_a_missing_extra_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as caught, reading_reported("info"):
        raise ImportError("needs the extra 'data': pip install pyarrow")
    assert caught.value.exit_code == 1
    expected = "limberjack: limberjack info needs the extra 'data': pip install pyarrow\n"
    assert capsys.readouterr().err == expected
