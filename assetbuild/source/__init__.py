"""A robot's description and files: brought here, read, and looked over."""
