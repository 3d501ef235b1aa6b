"""MJCF files: document, defaults, roles, edits, bounds, compilation. This room knows no quantity."""
