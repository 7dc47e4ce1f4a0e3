"""Calibration in the field: rests and turns by hand, the filter that calibrates from them, a coach that advises."""
