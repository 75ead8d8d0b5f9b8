"""Changes to modules that last as long as a viewer."""

from pathlib import Path
from types import ModuleType

import pytest

from limberjack.viewer.patches import private_settings, replaced


def test_a_module_has_its_own_value_again_after_an_error() -> None:
    module = ModuleType("module")
    module.__dict__["value"] = 1
    seen: list[int] = []

    def fail() -> None:
        seen.append(module.value)
        raise KeyError

    with pytest.raises(KeyError), replaced(module, "value", 2):
        fail()
    assert (seen, module.value) == ([2], 1)


def test_a_name_that_the_module_lacks_is_an_error() -> None:
    with pytest.raises(AttributeError, match="serve"), replaced(ModuleType("module"), "serve", 2):
        pass


def test_settings_are_saved_and_loaded_in_a_file_of_their_own() -> None:
    used: list[str] = []
    ux = ModuleType("ux")  # `cli/test_view.py` has the real one
    names = ("load_settings", "load_theme", "reset_config", "save_settings")
    for name in names:
        ux.__dict__[name] = lambda *arguments, ini_path="": used.append(ini_path)
    with private_settings(ux):
        for name in names:
            getattr(ux, name)()
        assert len(set(used)) == 1
        path = Path(used[0])
        assert path.parent.is_dir()
        assert path.parent != Path.home()
    assert not path.parent.exists()
    ux.save_settings()
    assert used[-1] == ""  # Studio's own function again
