"""The errors that all commands on datasets report alike."""

import io
import re
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import typer

from limberjack.cli.datasets import reading_reported
from limberjack.data import collect
from tests.episodes.collected import damaged

from .conftest import invoke


def _shorter(content: bytes) -> bytes:
    return content[:-1]


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
@pytest.mark.parametrize("forge", [_shorter, damaged, _as_a_pickle, _with_a_forged_recipe])
def test_a_forged_file_is_one_line_and_status_2(
    forge: Callable[[bytes], bytes],
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data"
    collect("pendulum", "swingup", "zero", range(2), out=folder, time_limit=0.1)
    (path,) = folder.glob("episodes/*")
    content = path.read_bytes()
    path.write_bytes(forge(content))
    result = invoke(*command, str(folder))
    assert result.exit_code == 2
    assert result.stdout == ""
    expected = f"limberjack: {path} (is damaged or no file of a dataset|has)"
    assert re.match(expected, result.stderr), result.stderr
    assert result.stderr.count("\n") == 1
    assert not Path("film.gif").exists()


@pytest.mark.parametrize("text", ["", "[]", "[" * 100_000, '{"format": 2, "recipe": 1}'])
@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["replay"],
        ["convert", "--to", "minari"],
        ["record", "--out", "film.gif", "--from"],
        ["collect", "pendulum", "swingup", "--time-limit", "0.1", "--seeds", "0:2", "--out"],
    ],
)
def test_a_forged_manifest_is_one_line_and_status_2(
    command: list[str], text: str, tmp_path: Path
) -> None:
    if command[0] == "convert":
        pytest.importorskip("minari", reason="needs the extra 'minari'")
    path = tmp_path / "dataset.json"
    path.write_text(text)
    result = invoke(*command, str(tmp_path))
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (2, "", 1)
    assert result.stderr.startswith(f"limberjack: {path} is damaged or no list of a dataset's")


def test_a_missing_extra_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as caught, reading_reported("info"):
        raise ImportError("needs the extra 'data': pip install pyarrow")
    assert caught.value.exit_code == 1
    expected = "limberjack: limberjack info needs the extra 'data': pip install pyarrow\n"
    assert capsys.readouterr().err == expected
