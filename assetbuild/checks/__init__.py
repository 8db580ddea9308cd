"""Checks: one file per question asked of a built robot."""

IN_FILE = {
    name: "_foreign" for name in ("asset_validator", "mjcf_doctor", "simcheck", "simready")
}
"""Plug-in -> the file that holds it beside others."""
