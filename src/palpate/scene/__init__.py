"""The incomplete scene: objects, surfaces, fixtures, names and places."""
