"""Meshes and textures: converted, thinned, given collision geometry, put in place."""
