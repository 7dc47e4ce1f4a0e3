"""Noise of IMU and GNSS tuned from the innovations of a recording's own fixes."""
