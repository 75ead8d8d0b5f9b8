"""Pictures and films in notebooks."""

import base64
import re
import sys
from typing import Any

import numpy as np
import pytest

import limberjack
from limberjack.see.notebook import Shown
from tests.programs import run

_PICTURE = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)


def _html(shown: object) -> str:
    assert isinstance(shown, Shown)
    return shown._repr_html_()


def _content(shown: object, kind: str) -> bytes:
    found = re.search(f'src="data:{kind};base64,([^"]+)"', _html(shown))
    assert found is not None
    return base64.b64decode(found[1])


def test_a_single_frame_is_a_picture() -> None:
    shown = limberjack.show(_PICTURE)
    assert _html(shown).startswith("<img ")
    assert _content(shown, "image/png").startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "frames",
    [
        [_PICTURE] * 3,
        np.stack([_PICTURE] * 3),
        tuple(np.stack([_PICTURE] * 3)),
        [np.stack([_PICTURE] * 2)] * 3,  # of a batch
        [np.zeros((5, 7, 3), np.uint8)] * 3,  # odd sides
    ],
    ids=["list", "array", "tuple", "batch", "odd"],
)
def test_several_frames_are_a_film(frames: Any) -> None:
    shown = limberjack.show(frames, fps=20)
    assert _html(shown).startswith("<video ")
    assert b"ftyp" in _content(shown, "video/mp4")[:12]


def test_a_generator_of_frames_is_a_film() -> None:
    rate: Any = np.float32(20)
    shown = limberjack.show((_PICTURE for _ in range(3)), rate)
    assert 'aria-label="3 rendered frames"' in _html(shown)


def test_small_pictures_are_enlarged_whole_times() -> None:
    assert "width: 336px" in _html(limberjack.show(np.zeros((84, 84, 3), np.uint8)))
    assert "width: 640px" in _html(limberjack.show(np.zeros((480, 640, 3), np.uint8)))


@pytest.mark.parametrize(
    ("frames", "fps", "message"),
    [
        ([], 30, r"frames have shape \(0,\)"),
        ([_PICTURE, _PICTURE[:4]], 30, r"shapes \[\(4, 8, 3\), \(6, 8, 3\)\]; expected one shape"),
        (np.zeros((2, 0, 6, 8, 3), np.uint8), 30, r"frames have shape \(2, 0, 6, 8, 3\)"),
        (np.zeros((4, 4)), 30, r"frames have shape \(4, 4\) and dtype float64; expected uint8"),
        (np.zeros((4, 4, 3)), 30, "dtype float64; expected uint8"),
        (np.zeros((4, 4, 1), np.uint8), 30, r"\(4, 4, 1\)"),
        ([_PICTURE] * 2, 0, "fps is 0; expected a positive number"),
        ([_PICTURE] * 2, float("nan"), "fps is nan; expected a positive number"),
    ],
)
def test_arrays_that_are_not_pictures_are_refused(frames: Any, fps: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        limberjack.show(frames, fps)


def test_a_film_without_ffmpeg_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install imageio-ffmpeg matplotlib pillow"):
        limberjack.show([_PICTURE] * 2)


def test_showing_imports_nothing_of_jupyter() -> None:
    program = """
        import sys
        import limberjack, numpy
        assert "numpy" in sys.modules
        limberjack.show(numpy.zeros((4, 4, 3), "uint8"))
        assert not {"IPython", "ipykernel", "imageio_ffmpeg"} & set(sys.modules)
    """
    run(program)
