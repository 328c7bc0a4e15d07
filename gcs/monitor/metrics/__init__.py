"""The run for machines: Prometheus metrics, health, and an API of which others build their own screens."""
