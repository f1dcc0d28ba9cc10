"""The kinds of tries of valid_medical.py."""
