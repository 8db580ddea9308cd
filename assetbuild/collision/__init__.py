"""Collision methods, one file each: a mesh in, convex or primitive pieces out."""
