"""Campaigns over many runs, and the bundled scenarios."""
