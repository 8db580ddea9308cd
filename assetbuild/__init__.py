"""assetbuild: a declarative build system for robot assets.

    bundle = assetbuild.build("recipes/go1.yaml")
    bundle = assetbuild.load_bundle("build/go1")

The functions are imported when they are used: `import assetbuild` costs a millisecond.
"""

__all__ = ["Bundle", "Facts", "__version__", "build", "load_bundle"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'assetbuild' has no attribute {name!r}")
    from importlib import import_module

    # By name: a release alone makes no step stale, as an import of the version would.
    module = "_version" if name == "__version__" else "api"
    return getattr(import_module(f"assetbuild.{module}"), name)
