"""Steps: what the plan wires together, one file each."""
