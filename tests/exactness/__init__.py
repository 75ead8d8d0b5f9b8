"""The long comparison with dm_control: `make test-exactness`, see `__main__`."""
