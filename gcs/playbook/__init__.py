"""Playbooks: what a run is about, written in YAML."""
