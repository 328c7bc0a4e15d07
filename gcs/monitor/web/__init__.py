"""The web dashboard: one page in any browser, served by a process of its own that only listens to the bus."""
