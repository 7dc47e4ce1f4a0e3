"""Strapdown mechanization and initial alignment."""
