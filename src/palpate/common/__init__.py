"""Shared foundations: errors, parameters, geometry, files, display, redaction, processes."""
