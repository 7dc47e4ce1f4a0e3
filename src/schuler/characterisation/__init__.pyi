from .allan import AllanCurve as AllanCurve
from .allan import allan_deviation as allan_deviation
from .autoregression import Autoregression as Autoregression
from .autoregression import Prediction as Prediction
from .autoregression import compare_predictions as compare_predictions
from .autoregression import fit_ar as fit_ar
from .correlation import Correlation as Correlation
from .correlation import FiniteRecord as FiniteRecord
from .correlation import autocorrelation as autocorrelation
from .correlation import expected_autocovariance as expected_autocovariance
from .correlation import expected_variance as expected_variance
from .correlation import finite_record as finite_record
from .correlation import mean_sigma as mean_sigma
from .curves import identify_curve as identify_curve
from .denoising import Denoised as Denoised
from .denoising import choose_level as choose_level
from .denoising import denoise as denoise
from .health import check_static_imu as check_static_imu
from .health import check_static_log as check_static_log
from .health import length_needed as length_needed
from .identification import identify_noise as identify_noise
from .manual import ManualNoise as ManualNoise
from .manual import allan_valley as allan_valley
from .manual import correlation_time as correlation_time
from .manual import identify_manually as identify_manually
from .manual import low_passed as low_passed
from .nonstationarity import LevelScatter as LevelScatter
from .nonstationarity import allow_for as allow_for
from .nonstationarity import level_scatter as level_scatter
from .outliers import without_outliers as without_outliers
from .report.document import noise_report as noise_report
from .report.figures import allan_figure as allan_figure
from .report.figures import save_noise_figures as save_noise_figures
from .report.spectra import log_spectra as log_spectra
from .result import AxisNoise as AxisNoise
from .result import Candidate as Candidate
from .result import Estimate as Estimate
from .result import Finding as Finding
from .result import NoiseIdentification as NoiseIdentification
from .shifts import level_shifts as level_shifts
from .spectrum import CleanSpectrum as CleanSpectrum
from .spectrum import Line as Line
from .spectrum import Spectrum as Spectrum
from .spectrum import clean_spectrum as clean_spectrum
from .spectrum import power_spectrum as power_spectrum
from .trends import Trend as Trend
from .trends import mean_with_sigma as mean_with_sigma
from .trends import settled_from as settled_from
from .trends import temperature_trend as temperature_trend
from .trends import warm_up as warm_up
from .turn_on import TurnOn as TurnOn
from .turn_on import record_means as record_means
from .turn_on import turn_on_bias as turn_on_bias
from .variance import on_grid as on_grid

__all__ = [
    "AllanCurve",
    "Autoregression",
    "AxisNoise",
    "Candidate",
    "CleanSpectrum",
    "Correlation",
    "Denoised",
    "Estimate",
    "Finding",
    "FiniteRecord",
    "LevelScatter",
    "Line",
    "ManualNoise",
    "NoiseIdentification",
    "Prediction",
    "Spectrum",
    "Trend",
    "TurnOn",
    "allan_deviation",
    "allan_figure",
    "allan_valley",
    "allow_for",
    "autocorrelation",
    "check_static_imu",
    "check_static_log",
    "choose_level",
    "clean_spectrum",
    "compare_predictions",
    "correlation_time",
    "denoise",
    "expected_autocovariance",
    "expected_variance",
    "finite_record",
    "fit_ar",
    "identify_curve",
    "identify_manually",
    "identify_noise",
    "length_needed",
    "level_scatter",
    "level_shifts",
    "log_spectra",
    "low_passed",
    "mean_sigma",
    "mean_with_sigma",
    "noise_report",
    "on_grid",
    "power_spectrum",
    "record_means",
    "save_noise_figures",
    "settled_from",
    "temperature_trend",
    "turn_on_bias",
    "warm_up",
    "without_outliers",
]
