"""mjlab: asked in its own environment."""
