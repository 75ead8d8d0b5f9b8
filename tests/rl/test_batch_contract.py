"""Both kinds of batch have everything that the interface names."""

import inspect

import pytest

from limberjack import rl, suite
from limberjack.rl.batch_contract import Batch

_MEMBERS = sorted(
    {name for name in vars(Batch) if not name.startswith("_")}
    | {name for name in Batch.__annotations__ if not name.startswith("_")}
)


@pytest.mark.parametrize("vectorised", [True, False])
def test_a_batch_has_every_member_of_the_interface(vectorised: bool) -> None:
    env = suite.load("cartpole", "swingup", {"random": 0, "time_limit": 0.1})
    batch = rl.batch_of(env, 2, seed=0, vectorised=vectorised)
    batch.reset()
    assert "reset" in _MEMBERS
    assert "num_envs" in _MEMBERS
    for name in _MEMBERS:
        assert hasattr(batch, name), name
        declared = inspect.getattr_static(Batch, name, None)
        if inspect.isfunction(declared):
            wanted = list(inspect.signature(declared).parameters)
            assert list(inspect.signature(getattr(type(batch), name)).parameters) == wanted, name
