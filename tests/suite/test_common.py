"""The files that domains share."""

import pytest

from limberjack.suite import common


def test_the_shared_files_are_read_by_the_names_they_are_included_by() -> None:
    names = ["./common/materials.xml", "./common/skybox.xml", "./common/visual.xml"]
    assert sorted(common.ASSETS) == names
    for name in names:
        assert common.ASSETS[name] == common.read_model(name)
    assert b"<mujoco" in common.read_model("humanoid.xml")
    with pytest.raises(FileNotFoundError, match=r"no_such_domain\.xml"):
        common.read_model("no_such_domain.xml")
