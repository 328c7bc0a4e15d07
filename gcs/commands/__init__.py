"""The commands of the command line, one module each; `gcs.cli` puts them together."""
