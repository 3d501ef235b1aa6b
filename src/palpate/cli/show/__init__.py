"""What the commands print: tables for people on a terminal, one JSON object for scripts."""
