"""Formations from files: the slots in a table, a ground station's plan or a map, each a reader of its own."""
