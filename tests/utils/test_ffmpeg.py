"""Tests of limberjack.utils.ffmpeg."""

import subprocess
import sys

import pytest

from limberjack.utils.ffmpeg import find_ffmpeg


def test_the_program_runs() -> None:
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    done = subprocess.run([find_ffmpeg(), "-version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("ffmpeg version")


def test_without_its_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match="needs the extra 'video': pip install imageio-ffmpeg"):
        find_ffmpeg()
