"""The models of dm_control, compiled once for several tests."""

import copy
import functools
from collections.abc import Iterator
from typing import Any

import mujoco
import pytest

__all__: list[str] = []

_KEPT = 4  # models; the tests of a task run one after the other and use one or two


@pytest.fixture(scope="module")
def compiled_once() -> Iterator[None]:
    """dm_control takes copies of models that it has compiled before, bit for bit the same.

    Otherwise compilation would take a third of the time of short tests. The tests of models and of
    whole episodes let dm_control compile.
    """
    from .oracle import theirs  # skips where dm_control is not installed

    core: Any = theirs("mujoco.wrapper.core")
    compile_anew = core._get_model_ptr_from_xml

    @functools.lru_cache(_KEPT)
    def compiled(xml_string: str | bytes, assets: tuple[tuple[str, bytes], ...]) -> mujoco.MjModel:
        return compile_anew(xml_string=xml_string, assets=dict(assets))

    def copy_of(xml_path: Any = None, xml_string: Any = None, assets: Any = None) -> Any:
        if xml_path is not None:
            return compile_anew(xml_path=xml_path)
        return copy.copy(compiled(xml_string, tuple((assets or {}).items())))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core, "_get_model_ptr_from_xml", copy_of)
        yield
