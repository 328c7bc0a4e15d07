"""The stages of a run: one module for each, a registry, and what runs them one after another."""
