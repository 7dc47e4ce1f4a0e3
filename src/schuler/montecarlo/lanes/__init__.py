"""Several runs in lock-step on vectors of the processor."""
