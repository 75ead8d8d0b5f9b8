"""The list of refused tasks is exactly what the rule on model fields refuses."""

from typing import Any

import pytest

from limberjack import gpu, suite

from .gpu.on_device import torch

model_fields: Any = pytest.importorskip("limberjack.gpu.model_fields")
pytestmark = pytest.mark.gpu


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_a_task_is_refused_if_and_only_if_it_is_on_the_list(domain: str, task: str) -> None:
    assert torch is not None
    fields = suite.load(domain, task)._saved_fields()
    reason = gpu.REFUSED.get((domain, task))
    if reason is None:
        model_fields.check(fields)
        return
    (field,) = fields
    assert field in reason
    with pytest.raises(ValueError, match=f"each episode has its own {field}, which MuJoCo Warp"):
        gpu.load_vector(domain, task, 2, device="cpu")


def test_the_list_names_tasks_that_exist() -> None:
    assert set(gpu.REFUSED) <= set(suite.ALL_TASKS)
