"""Robots drawn at random from the recipe's ranges."""
