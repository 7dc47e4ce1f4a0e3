"""Sensor error models: budgets, one realisation of the errors, noise processes, a catalogue, increments."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
