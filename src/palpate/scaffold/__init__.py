"""A scene to begin with: commented MJCF and poses, written from the names of things."""
