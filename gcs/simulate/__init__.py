"""Whole relays in virtual time: the service's own executor, monitor and guidance on the embedded copter's dynamics."""
