"""assetbuild: a declarative build system for robot assets."""

__version__ = "0.1.0"
