"""The version of the package; it imports nothing, so that everything may read it."""

__version__ = "0.2.0"
