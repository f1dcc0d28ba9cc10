"""The parts of the attack program for isonest view (tests/attack/server.py)."""
