"""Quality of a GNSS log against its own claims: outages, jumps, noise, inertial data inside, smoothing."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion, WindowMeans
from schuler.diagnosis.positions import GnssView
from schuler.diagnosis.result import Finding, Severity, number_of
from schuler.recording.series import GnssSeries

_DEAD_RECKONING = 7
_SMOOTH = 0.6  # gain of quick changes against slow ones
_LEAST = (0.01, 0.05, 0.05)  # RMS of quick changes worth comparing: turn [rad/s], forward, right [m/s^2]
_PATH = 0.8  # share of slow accelerations that the path explains, for quick ones to be the path's and not the body's
_QUICK_S = 1.5


def check_gnss(gnss: GnssSeries, view: GnssView) -> list[Finding]:
    """Findings that need the GNSS log only.

    Parameters
    ----------
    gnss : GnssSeries
    view : GnssView
        What of its velocities is to be trusted.
    """
    if len(gnss) < 10:
        return []
    findings = _outages(gnss)
    held = _held(gnss)
    findings += held
    findings += _quality(gnss)
    if not held:
        findings += _against_velocity(gnss, view)
    return findings


def _outages(gnss: GnssSeries) -> list[Finding]:
    step = np.diff(gnss.t)
    interval = float(np.median(step))
    gap = step > 1.8 * interval
    if not gap.any():
        return []
    k = int(np.argmax(step))
    lost = float(np.sum(step[gap] - interval))
    text = f"{number_of(gap.sum(), 'outage')}, {lost:.4g} s in all, the longest {step[k]:.4g} s from {gnss.t[k]:.2f} s"
    evidence = {"outages": int(gap.sum()), "lost_s": lost, "longest_s": float(step[k]), "at_s": float(gnss.t[k])}
    severity: Severity = (
        "warning" if step[k] > max(5.0, 4.0 * interval) or lost > 0.05 * (gnss.t[-1] - gnss.t[0]) else "note"
    )
    return [Finding("gnss_gaps", severity, text, 1.0, "", evidence, "gnss")]


def _held(gnss: GnssSeries) -> list[Finding]:
    """Positions that stay while the receiver moves."""
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh), gnss.llh[0])[:, :2]
    same = np.all(np.diff(gnss.llh[:, :2], axis=0) == 0.0, axis=1)
    n = 10
    if len(r) < 3 * n:
        return []
    # moving: the position some epochs before and after differs by much more than a digit
    wide = np.linalg.norm(r[2 * n :] - r[: -2 * n], axis=1)
    least = max(2.0, 0.2 * float(np.quantile(wide, 0.9)))
    moving = np.concatenate((np.zeros(n, dtype=bool), wide > least, np.zeros(n, dtype=bool)))
    use = moving[1:] & moving[:-1]
    if use.sum() < 20:
        return []
    share = float(np.mean(same[use]))
    if share < 0.15:
        return []
    text = (
        f"{100.0 * share:.0f} % of the positions repeat the one before while the receiver moves: they were "
        f"held or filled "
        "in to a higher rate"
    )
    return [Finding("gnss_repeated", "warning", text, 0.95, "keep the first of equal rows", {"share": share}, "gnss")]


def _quality(gnss: GnssSeries) -> list[Finding]:
    findings = []
    if gnss.quality is not None and np.mean(gnss.quality == _DEAD_RECKONING) > 0.02:
        share = float(np.mean(gnss.quality == _DEAD_RECKONING))
        text = (
            f"{100.0 * share:.0f} % of the epochs are marked dead reckoning: the solution is fused with inertial data "
            "already, to use it again counts them twice"
        )
        findings.append(Finding("gnss_fused", "warning", text, 0.95, "the receiver's GNSS-only solution", {}, "gnss"))
    else:
        rate = 1.0 / float(np.median(np.diff(gnss.t)))
        if rate > 30.0:
            text = (
                f"{rate:.4g} positions a second are more than receivers compute from satellites: the "
                f"solution holds inertial data already, or was interpolated"
            )
            evidence = {"rate_hz": rate}
            findings.append(
                Finding("gnss_fused", "warning", text, 0.8, "the receiver's GNSS-only solution", evidence, "gnss")
            )
    return findings


def _against_velocity(gnss: GnssSeries, view: GnssView) -> list[Finding]:
    """Displacements less the integral of velocity: jumps and noise."""
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh), gnss.llh[0])
    dt = np.diff(gnss.t)
    interval = float(np.median(dt))
    if view.other is not None and gnss.v_n is not None:
        v = np.stack([np.interp(gnss.t, view.t, x) for x in view.v_n.T], axis=1)
        left = np.diff(r, axis=0) - 0.5 * (v[1:] + v[:-1]) * dt[:, None]
        parts = 2.0
    else:
        if len(r) < 12:
            return []
        # third differences: a path is smooth beside its noise
        left = np.diff(r, 3, axis=0)
        parts = 20.0
        dt = dt[1:-1]
    complete = dt < 1.5 * interval
    left = left[complete]
    at = (gnss.t[1:] if len(complete) == len(gnss) - 1 else gnss.t[2:-1])[complete]
    if len(left) < 10:
        return []
    left = left - np.median(left, axis=0)
    sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
    stated = np.median(sigma, axis=0)
    spread = 1.4826 * np.median(np.abs(left), axis=0)
    size = np.linalg.norm(left[:, :2], axis=1)
    usual = max(float(np.quantile(size, 0.9)), float(np.hypot(spread[0], spread[1])), 1e-3)
    findings = []
    limit = max(8.0 * usual, 2.0, 6.0 * float(np.hypot(stated[0], stated[1])))
    jumps = size > limit
    if jumps.any() and np.mean(jumps) < 0.05:
        k = int(np.argmax(size))
        text = (
            f"{int(jumps.sum())} steps of the position are off by more than {limit:.3g} m from what the motion "
            f"allows, the "
            f"largest {size[k]:.4g} m at {at[k]:.2f} s: jumps (multipath, wrong fixes, joined logs)"
        )
        evidence = {"steps": int(jumps.sum()), "largest_m": float(size[k]), "at_s": float(at[k]), "usual_m": usual}
        findings.append(Finding("gnss_jumps", "warning", text, 0.9, "--robust, or leave these out", evidence, "gnss"))
    noise = spread / np.sqrt(parts)
    # curvature within an interval is no noise: half a metre a second squared for a third difference and the trapezoid
    floor = 0.05 + (0.35 * interval**2 if parts < 3.0 else 0.5 * interval**3)
    ratio = noise / stated
    worst = int(np.argmax(ratio))
    if ratio[worst] > 4.0 and noise[worst] > floor:
        alike = float(noise.max() / max(noise.min(), 1e-9))
        made = ", alike on all axes as noise added by a program would be" if alike < 1.25 else ""
        text = (
            f"positions scatter by {noise[0]:.3g}, {noise[1]:.3g}, {noise[2]:.3g} m (north, east, down) from "
            f"epoch to epoch, "
            f"{ratio[worst]:.0f} times their stated accuracy{made}: noise was added, or the accuracies are too good"
        )
        evidence = {"noise_m": noise.tolist(), "stated_m": stated.tolist(), "alike": alike}
        fix = "sigma='" + ",".join(f"{max(n, s):.2g}" for n, s in zip(noise, stated, strict=True)) + "'"
        findings.append(Finding("gnss_noise", "warning", text, 0.85, fix, evidence, "gnss"))
    return findings


def check_smoothing(means: WindowMeans, motion: Motion, lag: Lag) -> list[Finding]:
    """Whether quick motion comes through a GNSS solution as slow motion does, compared with the IMU.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    lag : Lag

    Notes
    -----
    Turn rate is regressed on the gyro, accelerations on the accelerometer; their gain for changes within some seconds,
    over that for all, is 1 for a solution of single epochs and falls when positions were filtered: a mean over 4 s
    halves it. Gains of all three are averaged with their weights.
    """
    gains = [g for k in range(3) if (g := quick_gain(means, motion, lag, k)) is not None]
    if not gains:
        return []
    weight = np.array([g[1] ** -2 for g in gains])
    value = float(weight @ [g[0] for g in gains] / weight.sum())
    sigma = float(weight.sum() ** -0.5)
    if value > _SMOOTH or value + 3.0 * sigma > 0.8:
        return []
    text = (
        f"quick turns and changes of speed come through the GNSS solution at {value:.2f} of the gain of slow ones "
        f"(1-sigma {sigma:.2f}): it was filtered or smoothed, its errors are correlated and its accuracies too good"
    )
    fix = "the receiver's unsmoothed solution; or larger sigma"
    evidence: dict[str, Any] = {"gain": value, "sigma": sigma}
    return [Finding("gnss_smoothed", "warning", text, 0.7, fix, evidence, "gnss")]


def quick_gain(means: WindowMeans, motion: Motion, lag: Lag, quantity: int = 0) -> tuple[float, float] | None:
    """Gain of changes within 3 s over that of all, and its 1-sigma.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    lag : Lag
    which : {0, 1, 2}
        Turn rate, forward or right acceleration.

    Returns
    -------
    tuple of float, optional
        None if there is too little quick motion, or a body whose accelerations are not those of its path.
    """
    if quantity and lag.r2[quantity] < _PATH:
        return None
    at = motion.t - lag.offset
    w, inside = means.at(at, motion.half)
    inside = inside & means.without_pause(at, motion.half)
    use = motion.moving & inside
    if use.sum() < 60:
        return None
    w = w[:, 3:] if quantity == 0 else w[:, :3]
    x = (motion.turn, motion.forward, motion.right)[quantity]
    A = np.concatenate((w[use], np.ones((int(use.sum()), 1))), axis=1)
    c, *_ = np.linalg.lstsq(A, x[use], rcond=None)
    fit = w @ c[:3]
    step = float(np.median(np.diff(motion.t)))
    n = max(round(_QUICK_S / step), 1)
    quick_fit, quick_x, ok = _high(fit, n), _high(x, n), _eroded(use, n)
    # stops make a course of noise: keep well clear of them
    a, b = quick_fit[ok], quick_x[ok]
    if len(a) < 60 or np.sqrt(np.mean(a**2)) < _LEAST[quantity]:
        return None
    # noise of the IMU is in both sums of squares; at rest it stands alone
    still = _eroded(inside & (motion.speed < 0.1), n)
    imu_noise = float(np.mean(quick_fit[still] ** 2)) if still.sum() > 20 else 0.0
    power = float(a @ a) - imu_noise * len(a)
    if power < 0.3 * float(a @ a):
        return None
    centred, path = fit[use] - fit[use].mean(), x[use] - x[use].mean()
    slow = float(centred @ path / max(float(centred @ centred) - imu_noise * int(use.sum()), 1e-300))
    gain = float(a @ b / power) / max(slow, 1e-9)
    noise = np.sqrt(np.mean((b - gain * slow * a) ** 2) / power * 4.0 * motion.half / step)
    return gain, max(float(noise / max(slow, 1e-9)), 0.01)


def _high(x: FloatArray, n: int) -> FloatArray:
    kernel = np.ones(2 * n + 1) / (2 * n + 1)
    return np.asarray(x - np.convolve(x, kernel, mode="same"))


def _eroded(use: BoolArray, n: int) -> BoolArray:
    return np.asarray(np.convolve(use.astype(float), np.ones(2 * n + 1), mode="same") > 2 * n + 0.5)
