"""What the verbs do: each module is a story that reads from top to bottom."""
