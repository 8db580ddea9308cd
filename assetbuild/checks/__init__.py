"""Checks: one file per question asked of a built robot; one for each tool that is asked many."""

_FILES = {
    "_foreign": ("asset_validator", "mjcf_doctor", "simcheck", "simready"),
    "_mujoco": ("free_fall", "grip", "loops", "policy_orders", "slope"),
    "_newton": (
        "newton_alignment",
        "newton_grip",
        "newton_loops",
        "newton_orders",
        "newton_slope",
    ),
    "_physx": (
        "alignment",
        "physx_free_fall",
        "physx_grip",
        "physx_loops",
        "physx_orders",
        "physx_slope",
    ),
}
IN_FILE = {name: file for file, names in _FILES.items() for name in names}
"""Plug-in -> the file that holds it beside others."""
