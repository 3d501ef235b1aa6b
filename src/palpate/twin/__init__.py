"""The finished twin: injection into the MJCF, validation, export."""
