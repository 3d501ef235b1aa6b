"""Output of results: tables for people on a terminal, one JSON object for scripts."""
