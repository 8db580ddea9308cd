"""Targets: one file per format that a bundle can hold."""
