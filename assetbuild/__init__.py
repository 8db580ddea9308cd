"""assetbuild: a declarative build system for robot assets.

    bundle = assetbuild.build("recipes/go1.yaml")
    bundle = assetbuild.load_bundle("build/go1")

The functions are imported when they are used: `import assetbuild` costs a millisecond.
"""

from assetbuild._version import __version__

__all__ = ["Bundle", "Facts", "__version__", "build", "load_bundle"]


def __getattr__(name: str) -> object:
    if name in __all__:
        from importlib import import_module

        return getattr(import_module("assetbuild.api"), name)
    raise AttributeError(f"module 'assetbuild' has no attribute {name!r}")
