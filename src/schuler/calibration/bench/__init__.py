"""Calibration on a bench: faces, poses, rate table, Ferraris, with covariance."""
