"""The paper's tables, recomputed beside what was printed."""
