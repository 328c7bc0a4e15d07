"""The zenoh bus: session, key expressions and messages between the UAVs and the ground."""
