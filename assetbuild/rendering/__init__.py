"""Pictures and the 3D view of the report."""
