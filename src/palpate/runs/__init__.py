"""A run: settings, pipeline, stages, folder, results, and the public API."""
