"""Triangle meshes: arrays in, arrays out. Metres, outward normals, float64."""

MESH_MODULES = (
    "numpy",
    "scipy.spatial",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "fast_simplification",
    "manifold3d",
)
"""All steps that work on meshes name these: they share one process that has imported them."""
