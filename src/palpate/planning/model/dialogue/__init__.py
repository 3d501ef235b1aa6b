"""Dialogue with a model: rounds of feedback, a critic, the record."""
