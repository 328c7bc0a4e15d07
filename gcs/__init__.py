"""The service: playbooks, relay execution, stop-condition monitor, safety, recording, screens, command line."""
