"""Instruments by which palpate is tested: speed, golden results, harm, faults, deceptions, bounds.

Not part of the wheel; run from the root of the repository with `python -m bench`.
"""
