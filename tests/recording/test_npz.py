"""Arrays of files that anybody may have written."""

import io
import os
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from limberjack.recording.npz import read_arrays

_ARRAYS = {
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "empty": np.zeros((0, 3)),
    "text": np.array("about"),
    "flags": np.array([True, False]),
    "big_endian": np.arange(3, dtype=">i4"),
}


def _npy(shape: str = "(3,)", dtype: str = "'<f8'", content: bytes = bytes(24)) -> bytes:
    """A .npy file with any header."""
    header = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + content


def _zip(path: Path, **files: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name.replace("_npy", ".npy"), content)
    return path


def test_arrays_are_those_that_numpy_wrote(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    for save in (np.savez, np.savez_compressed):
        save(path, **_ARRAYS)
        read = read_arrays(path)
        assert list(read) == list(_ARRAYS)
        for name, value in _ARRAYS.items():
            np.testing.assert_array_equal(read[name], value)
            assert (read[name].dtype, read[name].shape) == (value.dtype, value.shape)


def test_the_helper_makes_what_numpy_reads() -> None:
    np.testing.assert_array_equal(np.load(io.BytesIO(_npy())), np.zeros(3))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (_npy("(1000000000000,)"), "has shape .* which do not fit its size"),
        (_npy("(-3,)"), "which do not fit its size"),
        (_npy("(-1, -3)"), "which do not fit its size"),
        (_npy("(10**12,)"), "Cannot parse header|malformed"),
        (_npy("(1000000000000,)", "'<U0'", b""), "which do not fit its size"),
        (_npy(dtype="'|O'"), "holds pickled objects; expected numbers"),
        (_npy(dtype="'nonsense'"), "nonsense"),
        (_npy("3"), "shape is not valid"),
        (_npy("(3L,)"), "UserWarning"),
        (_npy("(" * 5000), "^(TokenError|RecursionError|MemoryError): "),
        (_npy()[:7], "EOF|magic"),
        (b"\x93NUMPY\x09\x00" + _npy()[8:], "version"),
        (b"", "EOF|magic"),
    ],
)
def test_a_forged_array_is_a_value_error_and_takes_no_memory(
    content: bytes, message: str, tmp_path: Path
) -> None:
    path = _zip(tmp_path / "forged.npz", array_npy=content)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=message):
            read_arrays(path)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_what_would_fill_more_than_a_gibibyte_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("array.npy", "w") as entry,
    ):
        for _ in range(1100):
            entry.write(bytes(2**20))
    assert path.stat().st_size < 2e6
    with pytest.raises(ValueError, match="its arrays fill 1,153,433,600 bytes; expected at most"):
        read_arrays(path)


def test_a_size_that_the_zip_file_understates_is_found_out(tmp_path: Path) -> None:
    content = _npy("(100000,)", content=bytes(800_000))
    path = _zip(tmp_path / "understated.npz", array_npy=content)
    size, small = struct.pack("<L", len(content)), struct.pack("<L", len(_npy()))
    path.write_bytes(path.read_bytes().replace(size, small))
    with pytest.raises(ValueError, match="Bad CRC-32"):
        read_arrays(path)


@pytest.mark.parametrize("files", [{"text": b"no array"}, {"folder/": b""}])
def test_what_is_no_array_is_refused(files: dict[str, bytes], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected one .npy per array"):
        read_arrays(_zip(tmp_path / "others.npz", **files))


def test_damage_anywhere_is_a_value_error_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    np.savez_compressed(path, actions=np.arange(50.0), about=np.array('{"task": "walk"}'))
    whole, random = path.read_bytes(), np.random.RandomState(0)
    refused = 0
    for _ in range(600):
        content = bytearray(whole[: random.randint(1, len(whole) + 1)])
        for place in random.randint(len(content), size=random.randint(4)):
            content[place] = random.randint(256)
        path.write_bytes(content)
        try:
            read = read_arrays(path)
        except ValueError:
            refused += 1
        else:
            assert all(isinstance(value, np.ndarray) for value in read.values())
    assert refused > 500


def test_a_file_that_is_not_there_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_arrays(tmp_path / "nothing.npz")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_what_may_never_end_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "episode.npz")
    for path in (tmp_path / "episode.npz", Path("/dev/zero")):
        with pytest.raises(ValueError, match=f"{path} is a .*; expected a regular file"):
            read_arrays(path)
