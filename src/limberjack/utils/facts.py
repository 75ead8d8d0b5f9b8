"""`Facts`: what identifies results, as values of JSON by name.

facts = {"domain": "humanoid", "task": "walk", "policy": "random", "versions": {...}}
title_of(facts)     # 'humanoid walk'
"""

from collections.abc import Mapping
from typing import Any

__all__ = ["Facts", "title_of"]

Facts = dict[str, Any]  # Any: values of JSON, whose types are not known before it is read


def title_of(facts: Mapping[str, object]) -> str:
    """The task that facts are about, or the function that made its environments."""
    return str(facts.get("environment") or f"{facts['domain']} {facts['task']}")
