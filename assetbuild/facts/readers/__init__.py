"""One reader of facts for each format: a file here, or an entry point of another package."""
