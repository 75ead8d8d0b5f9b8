"""The tests. A folder or module mirrors the one of the source that has its name.

Besides: `oracle` compares with dm_control, `laws` holds for every task, `contract` checks the shape
of the source and what the package promises as a whole, `clients` are programs written for
dm_control, `browser` drives Chromium.
"""
