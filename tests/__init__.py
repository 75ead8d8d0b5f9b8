"""The tests. Folders and modules mirror the source modules of the same name.

In addition: `oracle` compares with dm_control, `laws` holds for every task, `contract` checks the
structure of the source and the promises of the package as a whole, `clients` are programs written
for dm_control, `exactness` is the long comparison with dm_control, `browser` drives Chromium.
"""
