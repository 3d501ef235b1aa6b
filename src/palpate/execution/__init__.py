"""Execution of a plan: behavior tree, runner, rehearsal, controlled stop, and the cells with their robots."""
