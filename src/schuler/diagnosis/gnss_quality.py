"""How good a GNSS log is beside what it says of itself: outages, jumps, noise, inertial data inside."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.diagnosis.findings import Finding, Severity, number_of
from schuler.diagnosis.positions import GnssView
from schuler.recording.series import GnssSeries

_DEAD_RECKONING = 7


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
    found = _outages(gnss)
    held = _held(gnss)
    found += held
    found += _quality(gnss)
    if not held:
        found += _against_velocity(gnss, view)
    return found


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
    found = []
    if gnss.quality is not None and np.mean(gnss.quality == _DEAD_RECKONING) > 0.02:
        share = float(np.mean(gnss.quality == _DEAD_RECKONING))
        text = (
            f"{100.0 * share:.0f} % of the epochs are marked dead reckoning: the solution is fused with inertial data "
            "already, to use it again counts them twice"
        )
        found.append(Finding("gnss_fused", "warning", text, 0.95, "the receiver's GNSS-only solution", {}, "gnss"))
    else:
        rate = 1.0 / float(np.median(np.diff(gnss.t)))
        if rate > 30.0:
            text = (
                f"{rate:.4g} positions a second are more than receivers compute from satellites: the "
                f"solution holds inertial data already, or was interpolated"
            )
            evidence = {"rate_hz": rate}
            found.append(
                Finding("gnss_fused", "warning", text, 0.8, "the receiver's GNSS-only solution", evidence, "gnss")
            )
    return found


def _against_velocity(gnss: GnssSeries, view: GnssView) -> list[Finding]:
    """Displacements less the integral of velocity: jumps and noise."""
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh), gnss.llh[0])
    dt = np.diff(gnss.t)
    interval = float(np.median(dt))
    if view.other is not None and gnss.v_n is not None:
        v = view.v_n
        left = np.diff(r, axis=0) - 0.5 * (v[1:] + v[:-1]) * dt[:, None]
        parts = 2.0
    else:
        if len(r) < 12:
            return []
        # third differences: a path is smooth beside its noise
        left = np.diff(r, 3, axis=0)
        parts = 20.0
        dt = dt[1:-1]
    whole = dt < 1.5 * interval
    left = left[whole]
    at = (gnss.t[1:] if len(whole) == len(gnss) - 1 else gnss.t[2:-1])[whole]
    if len(left) < 10:
        return []
    left = left - np.median(left, axis=0)
    sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
    stated = np.median(sigma, axis=0)
    spread = 1.4826 * np.median(np.abs(left), axis=0)
    size = np.linalg.norm(left[:, :2], axis=1)
    usual = max(float(np.quantile(size, 0.9)), float(np.hypot(spread[0], spread[1])), 1e-3)
    found = []
    limit = max(8.0 * usual, 2.0, 6.0 * float(np.hypot(stated[0], stated[1])))
    far = size > limit
    if far.any() and np.mean(far) < 0.05:
        k = int(np.argmax(size))
        text = (
            f"{int(far.sum())} steps of the position are off by more than {limit:.3g} m from what the motion "
            f"allows, the "
            f"largest {size[k]:.4g} m at {at[k]:.2f} s: jumps (multipath, wrong fixes, joined logs)"
        )
        evidence = {"steps": int(far.sum()), "largest_m": float(size[k]), "at_s": float(at[k]), "usual_m": usual}
        found.append(Finding("gnss_jumps", "warning", text, 0.9, "--robust, or leave these out", evidence, "gnss"))
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
        found.append(Finding("gnss_noise", "warning", text, 0.85, fix, evidence, "gnss"))
    return found
