"""Pure mathematics of the bearing-only relay: no I/O, no clock, no threads."""
