"""Sizes and places fixed when the kernels were written, kept apart so that reading them does not import numba."""

#: Largest number of states; the row length of covariance arrays in the kernels.
MAX_STATES = 96
#: Most satellites whose slow errors, or ambiguities of their carriers, are states of their own at one time.
MOST_CHANNELS = 24
#: Numbers a measurement consists of, see ``measurements.py`` for their meaning by kind.
N_VALUES = 8
#: State blocks that measurements ask for; the kernels know them by their place here.
PLACES = (
    "lever", "mount", "odometer", "lever_v", "clock", "clock_2", "clock_3", "clock_4", "b_heading", "baro", "b_r",
    "b_v", "delay", "multipath_1", "ambiguity_1",
)  # fmt: skip
