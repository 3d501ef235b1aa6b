"""Samples and recordings of an execution, and their MCAP file."""
