"""What noise does this IMU have: Allan curves, spectra, identification, stationarity."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
