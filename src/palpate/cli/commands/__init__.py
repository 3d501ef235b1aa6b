"""The commands, a family a module. Heavy imports happen inside the commands, so that `--help` answers
at once.
"""
