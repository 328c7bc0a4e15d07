"""Relays flown with faults, and watched from outside: what must never happen, whatever fails."""
