"""The stages of the pipeline, one module each; `pipeline` puts them in their order."""
