"""The parts of geometry.py: hard volumes, an independent computation of the data's function, and judges of meshes."""
