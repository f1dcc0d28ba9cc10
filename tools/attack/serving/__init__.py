"""What the attacker of isonest view (tools/attack/server.py) is made of."""
