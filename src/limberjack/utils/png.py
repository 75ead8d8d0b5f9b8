"""`encode`: a picture as the bytes of a PNG file, using only zlib; `is_encoded` recognises them.

    Path("frame.png").write_bytes(png.encode(physics.render()))

Each row uses the filter with the smallest sum of absolute values, as the PNG specification
recommends, so files are about as small as those of other encoders. RGB only; no decoder.
"""

import struct
import zlib

import numpy as np

__all__ = ["BEGINNING", "encode", "is_encoded"]

BEGINNING = 41  # first bytes of a file that `is_encoded` needs

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_RGB_OF_8_BITS = bytes([8, 2, 0, 0, 0])  # depth, colour type, then the only defined values


def encode(picture: np.ndarray) -> bytes:
    """The PNG file of an RGB picture.

    Args:
      picture: (height, width, 3) uint8, top row first.

    Raises:
      ValueError: the picture has another shape or dtype, or is empty.
    """
    if picture.ndim != 3 or picture.shape[-1] != 3 or picture.dtype != np.uint8 or not picture.size:
        raise ValueError(
            f"picture has shape {picture.shape} and dtype {picture.dtype}; expected "
            "(height, width, 3) and uint8"
        )
    height, width, _ = picture.shape
    header = struct.pack(">2I", width, height) + _RGB_OF_8_BITS
    pixels = zlib.compress(_filtered(picture.reshape(height, -1).astype(np.int16)), 9)
    chunks = _chunk(b"IHDR", header), _chunk(b"IDAT", pixels), _chunk(b"IEND", b"")
    return _SIGNATURE + b"".join(chunks)


def is_encoded(beginning: bytes) -> bool:
    """Whether the first bytes of a file may be those of `encode`: RGB, and nothing but pixels."""
    size = slice(16, 24)
    if len(beginning) < BEGINNING:
        return False
    header = _chunk(b"IHDR", beginning[size] + _RGB_OF_8_BITS)
    start = _SIGNATURE + header
    return beginning.startswith(start) and beginning[BEGINNING - 4 : BEGINNING] == b"IDAT"


def _filtered(rows: np.ndarray) -> bytes:
    """Filter number and residuals of each row, for its best filter; `rows` is (height, bytes)."""
    left, above, corner = np.zeros_like(rows), np.zeros_like(rows), np.zeros_like(rows)
    left[:, 3:] = rows[:, :-3]
    above[1:] = rows[:-1]
    corner[1:] = left[:-1]
    guesses = [np.zeros_like(rows), left, above, (left + above) // 2, _paeth(left, above, corner)]
    residuals = np.stack([rows - guess for guess in guesses]).astype(np.uint8)
    # The sum of absolute residuals, as signed bytes, is a good predictor of the compressed size.
    sums = np.abs(residuals.view(np.int8).astype(np.int16)).sum(axis=-1)
    best = sums.argmin(axis=0)
    kept = residuals[best, np.arange(len(rows))]
    return np.column_stack([best.astype(np.uint8), kept]).tobytes()


def _paeth(left: np.ndarray, above: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """The neighbour that is nearest to left + above - corner (the PNG Paeth predictor)."""
    guess = left + above - corner
    to_left, to_above, to_corner = (abs(guess - near) for near in (left, above, corner))
    upper = np.where(to_above <= to_corner, above, corner)
    return np.where((to_left <= to_above) & (to_left <= to_corner), left, upper)


def _chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)
