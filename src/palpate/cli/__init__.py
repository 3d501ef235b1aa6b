"""The command line: it calls the public API only."""
