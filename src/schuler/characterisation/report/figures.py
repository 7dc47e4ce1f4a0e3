"""Figures of identified noise for print and slides (matplotlib); the same descriptions as in the HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from schuler.characterisation.report import panels as noise_panels
from schuler.characterisation.report import spectra as noise_spectra
from schuler.characterisation.report.spectra import Curve
from schuler.characterisation.report.terms import Unit
from schuler.characterisation.result import NoiseIdentification
from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting.drawing import draw, save_all
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def allan_figure(
    identification: NoiseIdentification,
    axes: Sequence[str] | str | None = None,
    unit: Unit = "datasheet",
    *,
    ax: Axes | None = None,
) -> Figure:
    """Allan deviation of every axis: curve with 95 % band, model, each fitted term, points read off.

    Parameters
    ----------
    identification : NoiseIdentification
    axes : sequence of str, optional
        Such as ``["gyro_x"]``; default all that were identified.
    unit : {"datasheet", "si"}
        deg/h and ug, or rad/s and m/s^2.
    ax : matplotlib axes, optional
        To draw into, for one axis.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If an axis was not identified, the unit is unknown, or there are several axes and one ``ax``.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    if unit not in ("datasheet", "si"):
        raise InputError(f"unit: expected 'datasheet' or 'si', got {unit!r}")
    return draw(noise_panels.allan(identification, axes, unit), ax)


def all_figures(
    identification: NoiseIdentification,
    *,
    imu: ImuSeries | None = None,
    spectra: Mapping[str, Curve] | None = None,
    correlations: Mapping[str, Curve] | None = None,
    unit: Unit = "datasheet",
) -> list[content.Figure]:
    """Descriptions of every figure there is something to show in.

    Parameters
    ----------
    identification : NoiseIdentification
    imu : ImuSeries, optional
        The recording, for the figure of the log itself.
    spectra : mapping of str to (ndarray, ndarray), optional
        Axis to frequencies [Hz] and two-sided densities [x^2/Hz].
    correlations : mapping of str to (ndarray, ndarray), optional
        Axis to lags [s] and autocovariances [x^2].
    unit : {"datasheet", "si"}

    Returns
    -------
    list of content.Figure
    """
    present = identification.axes
    figures = []
    if present:
        figures += [
            noise_panels.allan(identification, None, unit),
            noise_panels.comparison(identification, unit),
            noise_panels.ratio(identification),
        ]
    if spectra and any(name in present for name in spectra):
        figures.append(noise_spectra.spectrum(identification, spectra, unit))
    if correlations and any(name in present for name in correlations):
        figures.append(noise_spectra.autocorrelation(identification, correlations))
    if imu is not None:
        figures.append(noise_spectra.signals(identification, imu))
    return figures


def save_noise_figures(
    identification: NoiseIdentification,
    folder: Path | str,
    formats: Sequence[str] = ("png", "svg"),
    *,
    imu: ImuSeries | None = None,
    spectra: Mapping[str, Curve] | None = None,
    correlations: Mapping[str, Curve] | None = None,
    unit: Unit = "datasheet",
) -> list[Path]:
    """Write every figure of an identification.

    Parameters
    ----------
    identification : NoiseIdentification
    folder : Path or str
        Made if missing; files of the same name are replaced.
    formats : sequence of str
        ``png``, ``svg``, ``pdf``.
    imu, spectra, correlations, unit
        As for :func:`all_figures`.

    Returns
    -------
    list of Path
        ``allan``, ``allan_axes``, ``allan_ratio``, ... in each format; the same bytes for the same input.

    Raises
    ------
    InputError
        If a format is unknown.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    figures = all_figures(identification, imu=imu, spectra=spectra, correlations=correlations, unit=unit)
    return save_all(figures, folder, formats)
