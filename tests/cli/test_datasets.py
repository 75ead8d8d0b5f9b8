"""The errors that all commands on datasets report alike."""

from pathlib import Path

import pytest
import typer

from limberjack.cli.datasets import reading_reported

from .conftest import invoke


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


def test_a_missing_extra_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as caught, reading_reported("info"):
        raise ImportError("needs the extra 'data': pip install pyarrow")
    assert caught.value.exit_code == 1
    expected = "limberjack: limberjack info needs the extra 'data': pip install pyarrow\n"
    assert capsys.readouterr().err == expected
