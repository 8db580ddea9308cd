"""Actuators, poses, contact, sensors: the recipe's tables resolved on this robot."""
