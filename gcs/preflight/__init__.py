"""Preflight: what is looked at, vehicle by vehicle and over the fleet, before anything is armed."""
