"""Campaigns on rotating IMUs: what rotation is worth, at which rate, by which scheme, and for whom.

chapter3, static, rates, kinematic, accuracy
    Du's simulations, free-inertial tests at rest and driving, and the accuracy of calibrations, with Monte Carlo
    intervals: docs/rotary-static.md. They are made of emulation, drive, trial, rms, improvement, floor, static_tables.
zupt, integrated, outages, gauss_markov, lever_arms and their helpers
    Filters: turntable with zero velocity, GNSS with outages: docs/rotary-filters.md.
search, pareto, objective, named_schemes and their helpers
    Which scheme is best for an IMU, a mission and a platform: docs/rotary-search.md.
thesis_tables, filter_tables
    Printed numbers that ours stand beside.
"""
