"""The studies' results: tables on the terminal, or one JSON object."""
