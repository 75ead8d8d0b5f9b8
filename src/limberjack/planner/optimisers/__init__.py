"""Optimisers of plans: `base` has the verbs, `mppi` and `icem` are two of them."""
