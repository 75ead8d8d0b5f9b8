"""The humanoid's costs: standing, walking and running."""
