"""The order of the laws: all laws of a task one after the other."""

from pathlib import Path

import pytest

__all__: list[str] = []

_HERE = Path(__file__).parent


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sorts the laws in each file by task.

    The package keeps the models of a few tasks compiled. In this order they are those in use.
    """
    places: dict[object, int] = {}

    def place(item: pytest.Item) -> tuple[int, int]:
        call = getattr(item, "callspec", None)  # None without parameters
        task = call.params.get("task") if call and _HERE in item.path.parents else None
        file = places.setdefault(item.path, len(places))
        return file, places.setdefault((item.path, task), len(places))

    items.sort(key=place)
