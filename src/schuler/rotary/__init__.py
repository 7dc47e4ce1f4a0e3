"""IMUs that a platform turns: schedules of rotation, encoders, mechanization, modulation of errors.

schedule, schemes, usage
    ``C_bs(t)`` with exact rates; continuous, reciprocating, dwelling, dual-axis, cable-limited; what they ask.
encoder, platform_errors
    Readings of the platform's angles, and what their errors do.
rotating_imu, mechanization
    Motion and ideal output of the IMU, and navigation from it by two routes.
modulation, tables
    Errors in navigation axes, their means over a revolution and what is left of them.
sections
    Entries of a scenario's file.
du_axes
    Axes of Du (2015), whose tables are reproduced.
"""
