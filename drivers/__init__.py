"""The outside world: MAVLink links and autopilots, the zenoh bus, AOA sensors, simulators."""
