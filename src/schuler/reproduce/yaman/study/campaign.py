"""Monte Carlo of the field calibration over many IMUs of one grade."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from schuler.calibration.field.options import FieldOptions
from schuler.exceptions import InputError
from schuler.reproduce.yaman.study.runs import FieldJob, FieldRun, RestSource, field_run, processes, run_all
from schuler.reproduce.yaman.study.statistics import FieldCampaign
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec
from schuler.simulation.steps import Routine

Progress = Callable[[float], None]


def field_campaign(
    grade: str | ImuSpec,
    runs: int,
    *,
    seed: int = 1,
    routine: Routine | None = None,
    options: FieldOptions | None = None,
    rests: RestSource = "found",
    rate_hz: float = 100.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> FieldCampaign:
    """Draw IMUs, turn each by the routine, calibrate, compare with the truth.

    Parameters
    ----------
    grade : str or ImuSpec
        Entry of the catalogue (``yaman-automotive``, ``yaman-tactical``), or any specification.
    runs : int
        Do not depend on each other's number: run k is child k of the seed. Campaigns with one seed share all
        normalised draws, whatever the grade (as the source's did).
    seed : int
    routine : Routine, optional
        :func:`~schuler.simulation.routine.thesis_routine` by default, 540 s.
    options : FieldOptions, optional
        Options of the calibration; ``FieldOptions.thesis()`` for the source's.
    rests : {"found", "given"}
        Found in every log (as in the field; two thirds of the time), or taken from the routine.
    rate_hz : float
    workers : int, optional
        Processes; None: one a processor, fewer for few runs. The result does not depend on it.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    FieldCampaign
        On Ctrl-C the runs that were finished, at least two.

    Raises
    ------
    InputError
        If an argument is out of range, or hardly a run could be calibrated; the message has the first reason.

    Notes
    -----
    Heading is known to one degree, as the source's *known heading*. Processes start afresh ("spawn"): a script that
    calls this with more than one needs ``if __name__ == "__main__":``.

    References
    ----------
    Yaman (2017), section 5.2, tables 5.2 to 5.4.
    """
    if runs < 2:
        raise InputError(f"runs: expected two or more, statistics need them; got {runs}")
    spec = catalogue.spec(grade) if isinstance(grade, str) else grade
    given: dict[str, Any] = {} if routine is None else {"routine": routine}
    job = FieldJob(spec, options=options or FieldOptions(), rate_hz=rate_hz, rests=rests, **given)
    n = processes(workers, runs)
    begin = perf_counter()
    done, failed, complete = run_all(partial(field_run, job), seed, runs, n, 2, progress)
    if len(done) < 2:
        reason = f"; run {failed[0][0]}: {failed[0][1]}" if failed else ""
        raise InputError(f"{spec.name}: {len(done)} of {runs} runs could be calibrated, which is no campaign{reason}")
    return _collected(job, done, sorted(failed), perf_counter() - begin, n, complete)


def _collected(
    job: FieldJob,
    done: dict[int, FieldRun],
    failed: list[tuple[int, str]],
    seconds: float,
    workers: int,
    complete: bool,
) -> FieldCampaign:
    order = sorted(done)
    kept = [done[k] for k in order]
    kinds = dict.fromkeys(kind for r in kept for kind in r.nis)  # a log that sways has others than the rest
    return FieldCampaign(
        job, kept[0].names, np.array(order), np.array([r.modelled for r in kept]), np.array([r.estimate for r in kept]),
        np.array([r.covariance for r in kept]), kept[0].prior_sigma, np.array([r.passes for r in kept]),
        tuple(r.status for r in kept), {kind: np.array([r.nis.get(kind, np.nan) for r in kept]) for kind in kinds},
        tuple(failed), seconds, sum(r.cpu_s for r in kept), workers, complete,
    )  # fmt: skip
