"""Compiled networks that are kept for other tests, since compiling takes most of their time."""

import importlib.util
from typing import Any

import pytest


@pytest.fixture(scope="session", autouse=True)
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    if importlib.util.find_spec("jax") is None:
        return
    jax: Any = importlib.import_module("jax")
    jax.config.update("jax_compilation_cache_dir", str(tmp_path_factory.mktemp("compiled")))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
