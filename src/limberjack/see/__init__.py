"""Films, reports, and pictures in notebooks.

The modules here draw what they are handed and play nothing: `limberjack.episodes` plays, and the
viewer, which a person steers, is `limberjack.viewer`.
"""
