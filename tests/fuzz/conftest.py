"""The profile `long`, to search for hours: `pytest tests/fuzz --hypothesis-profile=long`."""

from hypothesis import settings

settings.register_profile("long", deadline=None)
