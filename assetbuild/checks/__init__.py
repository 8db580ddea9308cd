"""Checks: one file per question asked of a built robot."""

IN_FILE = dict.fromkeys(("asset_validator", "mjcf_doctor", "simcheck", "simready"), "_foreign")
"""Plug-in -> the file that holds it beside others."""
