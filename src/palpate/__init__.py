"""palpate: physics-accurate digital twins by touch."""

__version__ = "0.1.0"
