"""Checks: one file per question asked of a built robot; one for each tool that is asked many."""

IN_FILE = {
    **dict.fromkeys(("asset_validator", "mjcf_doctor", "simcheck", "simready"), "_foreign"),
    **dict.fromkeys(("free_fall", "grip", "loops", "policy_orders", "slope"), "_mujoco"),
    **dict.fromkeys(("oracle", "urdf_loads"), "_pinocchio"),
    **{f"newton_{asked}": "_newton" for asked in ("alignment", "grip", "loops", "orders", "slope")},
    **{f"physx_{asked}": "_physx" for asked in ("free_fall", "grip", "loops", "orders", "slope")},
    **dict.fromkeys(("alignment", "physx_readback"), "_physx"),
    "smoke_newton": "_newton",
}
"""Plug-in -> the file that holds it beside others."""
