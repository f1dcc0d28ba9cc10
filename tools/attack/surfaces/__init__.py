"""What geometry.py is made of: hard volumes, the data's function computed by itself, and judges of meshes."""
