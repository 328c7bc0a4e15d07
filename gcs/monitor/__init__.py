"""Screens: what the operator sees of a run."""
