"""Link nodes: shares of a fleet's links, flown where the links are, and the service's side of them.

A node holds vehicles' links with their setpoint streamers and stop monitors. The service speaks to it over the bus
only, owns every vehicle by one node at a time, and says so with a token that never falls.
"""
