"""Worlds: how the world of an environment differs from the suite's.

    suite.load("walker", "walk", faults="easy")
    suite.load("walker", "walk", appearance={"background": "noise", "colors": "hard"})
    evaluate("walker", "walk", policy, world={"faults": "easy"})

A `World` maps the names of options to their values. Each option is a keyword of
`control.Environment`, so it travels in `environment_kwargs` to single environments, batches and
Gymnasium's ids. `Environment.world` has the complete settings as values of JSON, which are part of
the identity of results and of the recipes of datasets, and which are accepted as an option again.
"""

from collections.abc import Mapping

__all__ = ["OPTIONS", "World"]

OPTIONS = frozenset({"appearance", "faults"})

World = Mapping[str, object]
