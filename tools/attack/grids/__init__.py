"""What valid_grids.py tries, a module for each library that writes the files."""
