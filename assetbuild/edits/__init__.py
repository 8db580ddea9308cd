"""Edits: named changes of the robot or its meshes, one file each."""
