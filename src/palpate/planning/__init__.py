"""Plans, planners, and the check of plans."""
