"""MuJoCo's enums, constants and functions under dm_control's names."""

import mujoco
import pytest

from limberjack.mujoco.wrapper import mjbindings, util


def test_enums_are_tuples_of_ints_with_mujocos_values() -> None:
    for name in ("mjtJoint", "mjtObj", "mjtGeom", "mjtDisableBit", "mjtRndFlag", "mjtWarning"):
        made, official = getattr(mjbindings.enums, name), getattr(mujoco, name).__members__
        assert made._fields == tuple(official)
        assert [type(value) for value in made] == [int] * len(made)
        assert [*made] == [int(value.value) for value in official.values()]
        assert getattr(mjbindings.enums, name) is made
    assert mjbindings.enums.mjtJoint.mjJNT_HINGE == 3
    with pytest.raises(AttributeError, match="has no enum 'mjtNothing'"):
        mjbindings.enums.mjtNothing  # noqa: B018
    with pytest.raises(AttributeError):
        mjbindings.enums.MjModel  # noqa: B018


def test_constants_are_mujocos() -> None:
    assert mjbindings.constants.mjMAXVAL == 1e10
    assert mjbindings.constants.mjNREF == mujoco.mjNREF
    for name in ("mjNOTHING", "mj_step", "MjModel"):
        with pytest.raises(AttributeError, match=f"has no constant '{name}'"):
            getattr(mjbindings.constants, name)


def test_functions_are_the_official_ones() -> None:
    assert mjbindings.mjlib.mj_step is mujoco.mj_step
    assert mjbindings.functions.mjlib is mjbindings.mjlib is util.get_mjlib()
    assert mjbindings.functions.mjDISABLESTRING == mujoco.mjDISABLESTRING
