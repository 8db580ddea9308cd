"""Recipes: the models, and the loader that knows line numbers."""
