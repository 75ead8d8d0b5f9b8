"""The models of dm_control, compiled once for several tests."""

import copy
import hashlib
from collections.abc import Iterator
from typing import Any

import mujoco
import pytest

__all__: list[str] = []


@pytest.fixture(scope="module")
def compiled_once() -> Iterator[None]:
    """dm_control takes a copy, bit for bit the same, of the last model if the source is the same.

    Otherwise compilation would take a third of the time of short tests. The tests of a task run one
    after the other, and use one model; several of dm_control's dog would take 70 MB each.
    """
    from .oracle import theirs  # skips where dm_control is not installed

    core: Any = theirs("mujoco.wrapper.core")
    compile_anew = core._get_model_ptr_from_xml
    last: dict[bytes, mujoco.MjModel] = {}

    def copy_of(xml_path: Any = None, xml_string: Any = None, assets: Any = None) -> Any:
        if xml_path is not None:
            return compile_anew(xml_path=xml_path)
        source = _digest(xml_string, assets or {})
        if source not in last:
            last.clear()
            last[source] = compile_anew(xml_string=xml_string, assets=assets)
        return copy.copy(last[source])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core, "_get_model_ptr_from_xml", copy_of)
        yield


def _digest(xml_string: str | bytes, assets: dict[str, bytes]) -> bytes:
    """A digest of a source; the files of dm_control's dog are 20 MB."""
    parts = [xml_string, *(part for file in assets.items() for part in file)]
    content = (part.encode() if isinstance(part, str) else part for part in parts)
    return b"".join(hashlib.sha256(part).digest() for part in content)
