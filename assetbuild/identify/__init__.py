"""Actuator numbers that were measured: parameters fitted to logs of the real robot."""
