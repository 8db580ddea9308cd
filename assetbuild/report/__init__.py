"""Reports: findings and provenance to JSON, HTML and the model card."""
