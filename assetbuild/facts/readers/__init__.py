"""One reader of facts for each format: a file here, or an entry point of another package."""

IN_FILE = {
    **dict.fromkeys(("bare", "mjcf", "mjx"), "_mjcf"),
    **dict.fromkeys(("usd", "usd_scene"), "_usd"),
    "scene_mjx": "scene",
}
"""Plug-in -> the file that holds it beside others."""
