"""Triangle meshes: arrays in, arrays out. Metres, outward normals, float64."""
