"""Checks: one file per question asked of a built robot; one for each tool that is asked many."""

IN_FILE = {
    **dict.fromkeys(("asset_validator", "mjcf_doctor", "simcheck", "simready"), "_foreign"),
    **dict.fromkeys(("free_fall", "grip", "loops", "policy_orders", "slope"), "_mujoco"),
    **{f"newton_{asked}": "_newton" for asked in ("alignment", "grip", "loops", "orders", "slope")},
    **{f"physx_{asked}": "_physx" for asked in ("free_fall", "grip", "loops", "orders", "slope")},
    "alignment": "_physx",
}
"""Plug-in -> the file that holds it beside others."""
