"""Poses from cameras, and rendered pictures."""
