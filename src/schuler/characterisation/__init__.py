"""What noise does this IMU have: Allan curves, spectra, identification, stationarity."""

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.correlation import autocorrelation
from schuler.characterisation.curve import AllanCurve
from schuler.characterisation.findings import Finding
from schuler.characterisation.identify import identify_noise
from schuler.characterisation.result import AxisNoise, Estimate, NoiseIdentification
from schuler.characterisation.spectrum import power_spectrum
from schuler.standstill.stationarity import StaticIntervals, static_intervals

__all__ = [
    "AllanCurve",
    "AxisNoise",
    "Estimate",
    "Finding",
    "NoiseIdentification",
    "StaticIntervals",
    "allan_deviation",
    "autocorrelation",
    "identify_noise",
    "power_spectrum",
    "static_intervals",
]
