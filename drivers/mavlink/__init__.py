"""MAVLink: links, vehicles, autopilots and the leased setpoint streamer."""
