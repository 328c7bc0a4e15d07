"""The terminal monitor: a run over ssh, from any machine that reaches its bus."""
