"""The options of the commands: each declared once, and those that belong together in groups.

A group is a dataclass whose fields are options; a command that has a parameter of its type takes all
of them (see `palpate.cli.command`).
"""
