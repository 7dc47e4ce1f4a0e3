"""Causes that would explain the evidence against a navigation run, the likeliest first."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.filtering.measurements import (
    FIX,
    GNSS_KINDS,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    VELOCITY,
    gate_threshold,
)
from schuler.navigation.evaluation.evidence import BUDGET, LEAST, Finding, kind_text, of_kind
from schuler.navigation.inputs.gnss_faults import LARGER, enlargement

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult

_OTHER_MOTION = 10.0  # noise of the IMU enlarged by so much, with biases no budget allows: not noise
_CONTRADICTION = (
    "IMU and GNSS tell of different motions: axes or mounting of the IMU (imu.mount_rpy_deg), clocks that differ "
    "(imu.clock_shift_s), or heading at the start (alignment); schuler check tells them apart"
)
_REVERSED = (
    "the gyroscope about the vertical turns against the course of the fixes: its sign is reversed (reading hint scale, "
    "such as 'gz=-1'), or the accelerometers show gravity instead of specific force, or the axes of the two differ: "
    "schuler check"
)
_LATE_OR_ELSEWHERE = (
    "the log hardly tells an offset of GNSS stamps from a lever arm, or the offset changes: state imu.clock_shift_s or "
    "gnss.lever_arm_m"
)
_LASTING = (
    "errors of the IMU that its noise does not have: scale, temperature, a mount that gives way (imu; "
    "schuler calibrate)"
)
#: Openings of notes on the log that explain a wreck.
_TELLING = ("GNSS velocities seem to be", "GNSS positions jump")


def causes(result: NavigationResult, findings: list[Finding]) -> list[str]:
    """Explanations of the evidence, the likeliest first: no more than three.

    Parameters
    ----------
    result : NavigationResult
    findings : list of Finding
        Of :func:`~.evidence.evidence`.
    """
    size = {f.key: f.size for f in findings}
    explained = [(0.85, note) for note in result.notes if note.startswith(_TELLING)]
    explained += [c for c in (_clock(result), _wrong_fixes(result, size), _wrong_model(result, size)) if c is not None]
    if any(key in size for key in ("numbers",)):
        explained.append((0.9, "states ran away: begin with fewer states, and look at gaps and spikes of the log"))
    if "noise" in size:
        explained.append((0.8, "the budget of the IMU is not this unit's or not its units': imu, schuler allan"))
    if "against course" in size:
        explained.append((0.97, _REVERSED))
    if "heading given" in size:
        explained.append((0.9, "the heading given is wrong (alignment.rpy_deg), or axes and mounting of the IMU are"))
    if "no noise" in size:
        explained.append((0.75, _CONTRADICTION))
    for note in (n for n in result.notes if n.startswith(LARGER)):
        factor = enlargement(note)
        if "GNSS" in note:
            explained.append(
                (0.55, f"GNSS states accuracies {factor:g} times too good: gnss.sigma_scale, or the floors")
            )
            continue
        explained.append((0.55, "the budget of the IMU is too small (imu; filter.tune = true finds one that fits)"))
        if factor >= _OTHER_MOTION and any(key.startswith("budget b_") for key in size):
            explained.append((0.7, _CONTRADICTION))
    slow_v = max(size.get(f"slow {code}", 0.0) for code in (VELOCITY, RANGE_RATE))
    slow_r = max(size.get(f"slow {code}", 0.0) for code in (POSITION, PSEUDORANGE))
    rejected = max((v for k, v in size.items() if k.startswith("rejected")), default=0.0)
    scale = _claims_too_small(result)
    if scale > 1.3:
        explained.append(
            (
                0.75 if not slow_r > 2.0 * scale**2 else 0.3,
                f"GNSS states accuracies {scale:.2g} times too good: gnss.sigma_scale, or the floors",
            )
        )
    if "slow left" in size or (size.get(f"slow {POSITION}", 0.0) > 1.5 * slow_v and rejected < 0.1):
        explained.append(
            (0.6, "GNSS has slow errors that its accuracies leave out: gnss.correlated, or a larger sigma_scale")
        )
    if f"slow {PSEUDORANGE}" in size:
        explained.append((0.6, "atmosphere and reflections make ranges wrong for minutes: a larger gnss.sigma_scale"))
    if slow_v or slow_r or any(k.startswith(("pause", "halves")) for k in size):
        explained.append(
            (
                0.5,
                "the IMU is worse than its budget (imu: noise, vibration, scale factors), or the lever arm "
                "(gnss.lever_arm_m) is wrong",
            )
        )
    if "halves delay" in size:
        explained.append((0.65, _LATE_OR_ELSEWHERE))
    aids = [k for k in size if k.startswith(("rejected", "nis")) and int(k.split()[1]) not in (*GNSS_KINDS, FIX)]
    if aids:
        names = " and ".join(dict.fromkeys(kind_text(int(k.split()[1])) for k in aids))
        explained.append((0.45, f"what {names} assumes does not hold: mount angles, lever arms, sigmas of that aid"))
    if "attitude" in size:
        explained.append((0.7, "the motion does not show the heading: give it (alignment.rpy_deg), or drive turns"))
    if "untested" in size:
        explained.append((0.8, "the run starts late in its log, or has too few fixes: give the attitude (alignment)"))
    if "unaided" in size:
        explained.append((0.85, _LASTING))
    if "untested time" in size:
        explained.append(
            (0.75, "the time without fixes is too long for what the log shows: name the IMU (imu.catalogue)")
        )
    if "claims" in size:
        explained.append((0.65, "fixes come too rarely for this IMU, or its tuned noise is too large: state it (imu)"))
    if not explained:
        explained.append((0.1, "the IMU or GNSS is worse than it states"))
    return list(dict.fromkeys(text for _, text in sorted(explained, key=lambda c: -c[0])))[:3]


def _clock(result: NavigationResult) -> tuple[float, str] | None:
    """Clocks that differ: velocity innovations that follow the acceleration, or its change between fixes.

    Fixes late by ``tau`` are off by ``-tau a``, of which a filter that follows them has taken in that of the last one.
    """
    own = of_kind(result.innovations, VELOCITY)
    own = own.where(np.isfinite(own.nis))
    T = result.trajectory
    if len(own) < 3 * LEAST or len(T.t) < 10:
        return None
    half = 0.5
    before, after = (np.clip(own.t + d, T.t[0], T.t[-1]) for d in (-half, half))
    v = T.v_eb_n
    at = [np.column_stack([np.interp(x, T.t, v[:, i]) for i in range(2)]) for x in (before, after)]
    a = (at[1] - at[0]) / np.maximum(after - before, 1e-9)[:, None]
    e = own.innovation[1:, :2]
    # large innovations count by their root: a filter that was thrown off has huge ones for other reasons
    w = 1.0 / np.maximum(np.linalg.norm(e, axis=1), own.sigma[1:, :2].mean(axis=1))
    A = np.stack((a[1:], a[:-1]), axis=-1)
    G = np.einsum("k,kij,kil->jl", w, A, A)
    if not np.linalg.cond(G) < 1e9:
        return None
    c = np.linalg.solve(G, np.einsum("k,kij,ki->j", w, A, e))
    tau = -float(c[0])
    explained = 1.0 - float(np.sum(w[:, None] * (e - A @ c) ** 2) / np.sum(w[:, None] * e * e))
    if abs(tau) < 0.1 or explained < 0.05:
        return None
    return (
        min(0.4 + 3.0 * explained, 0.95),
        "clocks that differ: velocity innovations follow the acceleration as if GNSS stamps were some "
        f"{abs(tau):.1g} s {'late' if tau > 0.0 else 'early'} (imu.clock_shift_s; gnss.delay_sigma_s estimates it)",
    )


def _wrong_fixes(result: NavigationResult, size: dict[str, float]) -> tuple[float, str] | None:
    """Wrong fixes: positions rejected while their velocities agree with the IMU."""
    inn = result.innovations
    own = of_kind(inn, POSITION)
    out = own.status == REJECTED
    velocities = of_kind(inn, VELOCITY)
    tested = np.isfinite(velocities.nis)
    if f"rejected {POSITION}" not in size or tested.sum() < LEAST or f"rejected {VELOCITY}" in size:
        return None
    return (
        0.8,
        f"the fixes are wrong between {own.t[out][0]:.1f} and {own.t[out][-1]:.1f} s: their positions contradict "
        "their own velocities, with which the IMU agrees",
    )


def _wrong_model(result: NavigationResult, size: dict[str, float]) -> tuple[float, str] | None:
    """Wrong axes, or a wrong attitude at the start: velocities contradict the IMU from the beginning on."""
    if "back" in size:
        return 0.95, "axes or mounting of the IMU are not forward, right, down: imu.mount_rpy_deg, or the reading hints"
    own = of_kind(result.innovations, VELOCITY)
    own = own.where(np.isfinite(own.nis))
    biased = max((v for k, v in size.items() if k.startswith("budget b_")), default=0.0)
    share = size.get(f"rejected {VELOCITY}", size.get(f"rejected {POSITION}", 0.0))
    if share < 0.2 or not (biased or len(own)):
        return None
    early = float(np.mean(own.status[: max(LEAST, len(own) // 5)] == REJECTED)) if len(own) else share
    given = any("(given attitude)" in note for note in result.notes)
    cause = "axes or mounting of the IMU (signs, exchanged axes, imu.mount_rpy_deg)"
    heading = "heading at the start (alignment)"
    first, second = (heading, cause) if given else (cause, heading)
    return 0.4 + 0.3 * early + (0.15 if biased > BUDGET[1] else 0.0), f"wrong {first}, or {second}"


def _claims_too_small(result: NavigationResult) -> float:
    """Factor by which the typical GNSS innovation exceeds its prediction; medians, so that faults do not count."""
    inn = result.innovations
    sizes = []
    for code in (POSITION, VELOCITY, PSEUDORANGE):
        own = of_kind(inn, code)
        own = own.where(own.nis >= 0.0)  # a covariance that broke down has negative ones
        if len(own) >= LEAST:
            sizes.append(float(np.sqrt(np.median(own.nis) / gate_threshold(0.5, int(own.freedom[0])))))
    # wrong claims of a receiver are wrong throughout; elsewhere positions and velocities suffer differently
    return min(sizes) if sizes and max(sizes) < 3.0 * min(sizes) else 0.0
