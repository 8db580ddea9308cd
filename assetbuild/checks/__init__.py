"""Checks: one file per question asked of a built robot."""
