"""Estimators, quantities, and recordings of other programs."""
