"""Triangle meshes: arrays in, arrays out."""
