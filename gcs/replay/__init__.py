"""Replay: what a run recorded, decided and shown once more."""
