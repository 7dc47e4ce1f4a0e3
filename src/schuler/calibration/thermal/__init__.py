"""Calibration over temperature: soaks and ramps."""
