"""A run that goes on where an earlier service ended: what it knew, and who is found in the air."""
