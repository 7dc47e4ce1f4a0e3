"""One error-state filter: states, error model, measurements, engine, smoother, live use."""
