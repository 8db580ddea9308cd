"""MJCF as a source: flattened and named first, then compiled by MuJoCo and taken over."""
