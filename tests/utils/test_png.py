"""PNG files, read back by another program's decoder."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from limberjack.utils import png


def _read(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


_RAMP = np.add.outer(np.arange(40), np.arange(50))[..., None] + np.array([0, 60, 120])
_NOISE = np.random.RandomState(0).randint(256, size=(40, 50, 3))
_EDGES = np.indices((40, 50)).sum(axis=0)[..., None] // 7 % 2 * np.array([255, 0, 128])


@pytest.mark.parametrize("picture", [_RAMP, _NOISE, _EDGES, _NOISE[:1, :1], _NOISE[::2, ::-1]])
def test_a_picture_is_read_back_as_it_was(picture: np.ndarray, tmp_path: Path) -> None:
    picture = picture.astype(np.uint8)
    path = tmp_path / "picture.png"
    path.write_bytes(png.encode(picture))
    np.testing.assert_array_equal(_read(path), picture)


def test_smooth_pictures_are_small() -> None:
    assert len(png.encode(_RAMP.astype(np.uint8))) < _RAMP.size / 10


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((4, 4), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((4, 4, 3)),
        np.zeros((0, 4, 3), np.uint8),
    ],
)
def test_arrays_that_are_not_rgb_pictures_are_refused(picture: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"expected \(height, width, 3\) and uint8"):
        png.encode(picture)


def test_a_file_of_this_encoder_is_known_by_its_beginning(tmp_path: Path) -> None:
    encoded = png.encode(_RAMP.astype(np.uint8))
    assert png.is_encoded(encoded[: png.BEGINNING])
    assert not png.is_encoded(encoded[: png.BEGINNING - 1])
    assert not png.is_encoded(b"")
    assert not png.is_encoded(b"hours of work" * 10)
    other = tmp_path / "other.png"
    Image.fromarray(_RAMP.astype(np.uint8)).convert("RGBA").save(other)
    assert not png.is_encoded(other.read_bytes())
