"""What a calibration is: parameters with covariance, files, comparisons."""
