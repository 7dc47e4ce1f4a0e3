"""Initial state and covariance: alignment, sensor errors from calibrations and rests."""
