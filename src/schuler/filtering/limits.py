"""Sizes fixed when the kernels were written, kept apart so that reading them does not import numba."""

#: Largest number of states; the row length of covariance arrays in the kernels.
MAX_STATES = 64
