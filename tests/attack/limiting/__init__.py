"""The kinds of tries of limits.py."""
