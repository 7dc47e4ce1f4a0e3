"""Calibration of IMUs on a bench: static poses, turntables, temperature; results with covariance and advice.

Import from the modules, one for each method: ``schuler.calibration.freepose.calibrate.calibrate_freepose`` and so on;
the methods are also names of :mod:`schuler` itself.
"""
