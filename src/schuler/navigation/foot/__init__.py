"""Navigation of an IMU on a shoe: stances, strides, zero-velocity updates."""
