"""Batches with the interfaces of learning libraries, one module for each library.

Each module needs the extra of its library, and no other module imports that library.
"""
