"""Simulated motion, sensors and aiding."""
