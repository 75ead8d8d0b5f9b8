"""Fields that rows may differ in."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite

from .on_device import torch

pytestmark = pytest.mark.gpu
model_fields: Any = pytest.importorskip("limberjack.gpu.model_fields")


def test_fields_that_warp_shares_are_refused() -> None:
    assert torch is not None
    model_fields.check(("body_pos", "opt.gravity", "site_rgba", "site_size"))
    with pytest.raises(ValueError, match=r"its own hfield_data, .*limberjack\.gym\.load_vector"):
        model_fields.check(("body_pos", "hfield_data"))


def test_only_fields_of_warps_model_are_held_for_each_row() -> None:
    names = ("site_size", "geom_pos", "opt.gravity", "body_pos", "wrap_prm")
    assert model_fields.batched(names) == ("body_pos", "geom_pos")


def test_sites_that_sensors_measure_within_share_their_sizes() -> None:
    official = suite.load("finger", "turn_easy").physics.model._official
    shared = model_fields.shared_elements(official, "site_size")
    names = [official.site(i).name for i in np.flatnonzero(shared.any(axis=-1))]
    assert names == ["touchtop", "touchbottom"]
    assert not model_fields.shared_elements(official, "site_pos").any()


def test_values_of_options_are_read_by_their_dotted_name() -> None:
    official = suite.load("cartpole", "balance").physics.model._official
    assert model_fields.values(official, "opt.timestep") == 0.01
