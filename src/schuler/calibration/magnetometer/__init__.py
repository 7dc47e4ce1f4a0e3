"""Calibration of a magnetometer in the poses of an IMU: hard iron, soft iron, alignment."""
