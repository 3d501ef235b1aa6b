"""The stages of the pipeline; `pipeline` calls them in order."""
