"""The relay: the state of each receiver, and the executor that brings them to their slots."""
