"""AOA sensors: what measures bearings on a receiving UAV and puts them on the bus."""
