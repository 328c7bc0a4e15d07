"""What the service's own recorders kept of a run, against what they were given: nothing may be lost."""
