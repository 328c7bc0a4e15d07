"""Simulated vehicles: embedded copters, each a process of its own that speaks real MAVLink 2."""
