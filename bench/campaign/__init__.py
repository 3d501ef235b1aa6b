"""The one campaign engine: cases, their rows in a ledger that is resumed, and their HTML page."""
