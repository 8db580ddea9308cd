"""Isaac Lab: asked in its own environment."""
