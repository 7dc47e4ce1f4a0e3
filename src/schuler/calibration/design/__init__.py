"""Plans of calibrations: which poses, how long."""
