"""Modules imported from source that was shipped."""

import importlib
import sys
from collections.abc import Iterator

import pytest

from limberjack.utils.sources import Source
from limberjack.workers.shipped_modules import import_shipped


@pytest.fixture(autouse=True)
def _imports() -> Iterator[None]:
    modules, finders = set(sys.modules), list(sys.meta_path)
    yield
    sys.meta_path[:] = finders
    for name in set(sys.modules) - modules:
        del sys.modules[name]


def test_a_module_is_imported_without_a_file() -> None:
    import_shipped("shipped_alone", Source("", {"shipped_alone.py": b"x = 'h\xc3\xa9'\n"}))
    module = importlib.import_module("shipped_alone")
    assert module.x == "h\u00e9"
    assert not hasattr(module, "__file__")


def test_a_package_is_imported_with_its_parts() -> None:
    files = {
        "__init__.py": b"from shipped_package import late\n",
        "late.py": b"from .networks import small\ny = small.x\n",
        "networks/small.py": b"x = 3\n",
    }
    import_shipped("shipped_package.late", Source("shipped_package", files))
    assert importlib.import_module("shipped_package.late").y == 3


def test_a_package_within_others_is_imported() -> None:
    import_shipped("a_root.inner.act", Source("a_root.inner", {"act.py": b"x = 3\n"}))
    assert importlib.import_module("a_root.inner.act").x == 3


def test_a_package_that_is_missing_is_named_and_leaves_no_finder() -> None:
    before = list(sys.meta_path)
    with pytest.raises(ModuleNotFoundError, match="not_installed_anywhere"):
        import_shipped("needy", Source("", {"needy.py": b"import not_installed_anywhere\n"}))
    assert sys.meta_path == before


def test_a_traceback_shows_the_source() -> None:
    import linecache

    import_shipped("shipped_wrong", Source("", {"shipped_wrong.py": b"def f():\n    1 / 0\n"}))
    module = importlib.import_module("shipped_wrong")
    linecache.lazycache("<shipped>", vars(module))
    with pytest.raises(ZeroDivisionError):
        module.f()
