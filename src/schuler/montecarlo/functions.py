"""What a campaign runs: any function of a scenario and a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np

from schuler.exceptions import InputError, MissingExtraError
from schuler.montecarlo.rows import Rows, batch_rows, joined, row

#: ``function(scenario, seed) -> dict``, or ``function(scenario, seeds) -> dict`` if it takes batches.
RunFunction: TypeAlias = Callable[[Any, Any], Any]
F = TypeVar("F", bound=Callable[..., Any])

#: Errors that mean "this run could not be done"; others are defects and end the campaign.
FAILURES = (InputError, ArithmeticError, np.linalg.LinAlgError)
_MARK = "montecarlo_traits"


@dataclass(frozen=True)
class Traits:
    """What the engine has to know of a function.

    Attributes
    ----------
    batched : bool
        It takes a list of seeds and gives arrays whose first axis are the runs. What it gives of a run must not depend
        on the others of the batch.
    threads : bool
        It spends its time in compiled code that releases the interpreter's lock: threads share the work without
        starting processes.
    preferred : int
        Runs that it does best together.
    """

    batched: bool = False
    threads: bool = False
    preferred: int = 1


def traits(*, batched: bool = False, threads: bool = False, preferred: int = 1) -> Callable[[F], F]:
    """Decorator that tells the engine about a function, see :class:`Traits`."""

    def mark(function: F) -> F:
        setattr(function, _MARK, Traits(batched, threads, preferred))
        return function

    return mark


def traits_of(function: Any) -> Traits:
    """What is known of a function; of a ``functools.partial``, what is known of what it calls."""
    while not hasattr(function, _MARK) and hasattr(function, "func"):
        function = function.func
    marked = getattr(function, _MARK, Traits())
    assert isinstance(marked, Traits)
    return marked


def run_seed(seed: int, run: int) -> np.random.SeedSequence:
    """Seed of one run of a campaign: depends on the two numbers and on nothing else."""
    return np.random.SeedSequence(seed, spawn_key=(run,))


def execute(function: RunFunction, scenario: Any, seed: int, first: int, last: int) -> Rows:
    """Runs ``first`` to ``last``, both included, wherever this is called.

    Notes
    -----
    A run that raises :class:`~schuler.exceptions.InputError`, ``ArithmeticError`` or ``LinAlgError``, or gives
    something that is not finite, is a failure with its reason. Any other error is a defect and is raised.
    """
    numbers = range(first, last + 1)
    if traits_of(function).batched:
        return _batch(function, scenario, seed, numbers)
    return joined(_one(function, scenario, seed, k) for k in numbers)


def _one(function: RunFunction, scenario: Any, seed: int, run: int) -> Rows:
    try:
        result = function(scenario, run_seed(seed, run))
    except MissingExtraError:
        raise
    except FAILURES as error:
        return _failed(run, error)
    return row(run, result)


def _batch(function: RunFunction, scenario: Any, seed: int, numbers: range) -> Rows:
    try:
        result = function(scenario, [run_seed(seed, k) for k in numbers])
    except MissingExtraError:
        raise
    except FAILURES as error:
        if len(numbers) == 1:
            return _failed(numbers[0], error)
        # which of them it was: one at a time
        return joined(_batch(function, scenario, seed, range(k, k + 1)) for k in numbers)
    return batch_rows(numbers, result)


def _failed(run: int, error: Exception) -> Rows:
    text = " ".join(str(error).split())
    return Rows(np.zeros(0, dtype=np.int64), {}, {run: f"{type(error).__name__}: {text}" if text else repr(error)})
