"""Domains of installed packages, by their entry points."""

import sys
from pathlib import Path

import pytest

from limberjack.suite import _entry_points as entry_points


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory in which packages can be installed."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def _install(site: Path, package: str, *lines: str) -> None:
    metadata = site / f"{package}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("\n".join([f"[{entry_points.GROUP}]", *lines, ""]))


def test_modules_are_found_by_the_name_of_the_domain_and_not_imported(site: Path) -> None:
    _install(site, "pendula", "swing = pendula.swing", "double = pendula.double")
    assert entry_points.installed() == {"double": ["pendula.double"], "swing": ["pendula.swing"]}
    assert entry_points.module_of("swing") == "pendula.swing"
    assert entry_points.module_of("triple") is None
    assert "pendula" not in sys.modules


def test_a_name_in_several_packages_is_an_error_that_names_them(site: Path) -> None:
    _install(site, "one", "swing = one.swing")
    _install(site, "two", "swing = two.swing")
    with pytest.raises(ValueError, match=r"several installed packages: \w+\.swing, \w+\.swing"):
        entry_points.module_of("swing")
