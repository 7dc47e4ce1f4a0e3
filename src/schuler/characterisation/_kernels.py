"""Sums of squared differences behind the Allan deviations.

All take the running sum X of the signal (n + 1 values, mean removed) and the averaging times as numbers of samples.
Two rules make them fast: the loop over blocks is outside the loop over averaging times, so a block is read from the
cache by all of them; and the arrays are cut into slices before the innermost loop, which frees it from index checks.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64
from numba.extending import intrinsic

from schuler.jit import kernel, prepare

BLOCK = 32768


@intrinsic
def plus(_, a, b):
    """The sum a + b as part of a longer one whose order the compiler may choose.

    All other sums of the package keep their order. A sum of squares loses nothing by several partial sums (it gains
    digits), and only so the loop over it becomes four at a time.
    """

    def build(_context, builder, _signature, arguments):
        return builder.fadd(*arguments, flags=("reassoc", "contract"))

    return float64(a, b), build


@kernel
def running_sum(x, mean, out):
    """out[k] = sum of the first k values of x - mean; out has one element more than x."""
    total = 0.0
    out[0] = 0.0
    for i in range(x.shape[0]):
        total += x[i] - mean
        out[i + 1] = total


@kernel
def second_differences(X, ms, first, stop, out):
    """Add to out[q] the squares of X[i+2m] - 2 X[i+m] + X[i] for first <= i < stop."""
    for b in range(first, stop, BLOCK):
        for q in range(ms.shape[0]):
            m = ms[q]
            end = min(b + BLOCK, stop, X.shape[0] - 2 * m)
            if end <= b:
                continue
            x0 = X[b:end]
            x1 = X[b + m : end + m]
            x2 = X[b + 2 * m : end + 2 * m]
            total = 0.0
            for i in range(x0.shape[0]):
                d = (x2[i] - x1[i]) - (x1[i] - x0[i])
                total = plus(total, d * d)
            out[q] += total


@kernel
def third_differences(X, ms, first, stop, out):
    """Add to out[q] the squares of X[i+3m] - 3 X[i+2m] + 3 X[i+m] - X[i] for first <= i < stop."""
    for b in range(first, stop, BLOCK):
        for q in range(ms.shape[0]):
            m = ms[q]
            end = min(b + BLOCK, stop, X.shape[0] - 3 * m)
            if end <= b:
                continue
            x0 = X[b:end]
            x1 = X[b + m : end + m]
            x2 = X[b + 2 * m : end + 2 * m]
            x3 = X[b + 3 * m : end + 3 * m]
            total = 0.0
            for i in range(x0.shape[0]):
                d = (x3[i] - x0[i]) - 3.0 * (x2[i] - x1[i])
                total = plus(total, d * d)
            out[q] += total


@kernel
def modified_differences(X, ms, first, stop, sums, out):
    """Add to out[q] the squares of the sums over m second differences that start at first <= j < stop.

    ``sums[q]`` carries the running sum from one call to the next. Where m is less than a block it is formed anew at
    the start of every block, so rounding does not pile up.
    """
    for b in range(first, stop, BLOCK):
        for q in range(ms.shape[0]):
            m = ms[q]
            end = min(b + BLOCK, stop, X.shape[0] - 3 * m + 1)
            if end <= b:
                continue
            if b == 0 or m <= BLOCK:
                total = 0.0
                for i in range(b, b + m):
                    total += (X[i + 2 * m] - X[i + m]) - (X[i + m] - X[i])
            else:
                total = sums[q]
            square = total * total
            x0 = X[b : end - 1]
            x1 = X[b + m : end - 1 + m]
            x2 = X[b + 2 * m : end - 1 + 2 * m]
            x3 = X[b + 3 * m : end - 1 + 3 * m]
            for i in range(x0.shape[0]):
                total += (x3[i] - x0[i]) - 3.0 * (x2[i] - x1[i])
                square += total * total
            j = end - 1
            if j + 3 * m < X.shape[0]:
                total += (X[j + 3 * m] - X[j]) - 3.0 * (X[j + 2 * m] - X[j + m])
            sums[q] = total
            out[q] += square


@kernel
def apart(X, ms, order, out):
    """Squares of second (order 2) or third differences whose starts are m apart."""
    for q in range(ms.shape[0]):
        m = ms[q]
        total = 0.0
        if order == 2:
            for i in range(0, X.shape[0] - 2 * m, m):
                d = (X[i + 2 * m] - X[i + m]) - (X[i + m] - X[i])
                total += d * d
        else:
            for i in range(0, X.shape[0] - 3 * m, m):
                d = (X[i + 3 * m] - X[i]) - 3.0 * (X[i + 2 * m] - X[i + m])
                total += d * d
        out[q] = total


@kernel
def reflected_differences(X, ms, out):
    """Squares of second differences centred on every inner point of X, which is turned about both of its ends."""
    last = X.shape[0] - 1
    for q in range(ms.shape[0]):
        m = ms[q]
        total = 0.0
        for i in range(1, last):
            left = X[i - m] if i >= m else 2.0 * X[0] - X[m - i]
            right = X[i + m] if i + m <= last else 2.0 * X[last] - X[2 * last - i - m]
            d = (right - X[i]) - (X[i] - left)
            total += d * d
        out[q] = total


@kernel
def gappy_clusters(S, C, ms, order, stride, least, out, excess, count):
    """Differences of cluster means of the samples that are there; S and C are running sums of values and presence.

    A difference counts if every cluster has at least ``least * m`` samples. ``excess`` gets the sum over differences of
    what white noise of unit variance adds because samples are missing.
    """
    n = S.shape[0] - 1
    for q in range(ms.shape[0]):
        m = ms[q]
        need = least * m
        step = 1 if stride == 0 else m
        for i in range(0, n - order * m + 1, step):
            c0 = C[i + m] - C[i]
            c1 = C[i + 2 * m] - C[i + m]
            if c0 < need or c1 < need:
                continue
            y0 = (S[i + m] - S[i]) / c0
            y1 = (S[i + 2 * m] - S[i + m]) / c1
            if order == 2:
                d = y1 - y0
                out[q] += d * d
                excess[q] += 1.0 / c0 + 1.0 / c1 - 2.0 / m
                count[q] += 1
            else:
                c2 = C[i + 3 * m] - C[i + 2 * m]
                if c2 < need:
                    continue
                d = (S[i + 3 * m] - S[i + 2 * m]) / c2 - 2.0 * y1 + y0
                out[q] += d * d
                excess[q] += 1.0 / c0 + 4.0 / c1 + 1.0 / c2 - 6.0 / m
                count[q] += 1


@kernel
def gappy_integral(X, ms, order, stride, out, count):
    """Second or third differences of an integral none of whose values is missing (NaN)."""
    for q in range(ms.shape[0]):
        m = ms[q]
        step = 1 if stride == 0 else m
        for i in range(0, X.shape[0] - order * m, step):
            if order == 2:
                d = (X[i + 2 * m] - X[i + m]) - (X[i + m] - X[i])
            else:
                d = (X[i + 3 * m] - X[i]) - 3.0 * (X[i + 2 * m] - X[i + m])
            if not np.isnan(d):
                out[q] += d * d
                count[q] += 1


@kernel
def draw_states(good, bad, share, lasting, u, out):
    """Draw which samples are in the second state of a Markov chain of two states.

    ``good`` and ``bad`` are the likelihoods of each sample in either state, ``share`` the probability of the second,
    ``lasting`` that it follows itself, ``u`` uniform numbers. Probabilities go forwards, states are drawn backwards.
    """
    n = good.shape[0]
    begins = share * (1.0 - lasting) / (1.0 - share)
    forward = np.empty(n)
    p = share
    for i in range(n):
        if i > 0:
            p = p * lasting + (1.0 - p) * begins
        p = p * bad[i] / (p * bad[i] + (1.0 - p) * good[i])
        forward[i] = p
    for i in range(n - 1, -1, -1):
        p = forward[i]
        if i < n - 1:
            to_bad, to_good = p * lasting, (1.0 - p) * begins
            if not out[i + 1]:
                to_bad, to_good = p * (1.0 - lasting), (1.0 - p) * (1.0 - begins)
            p = to_bad / (to_bad + to_good)
        out[i] = u[i] < p


def prepare_allan(gaps: bool) -> None:
    """Compile or load the kernels of one branch, with a word to the user if that takes long."""
    f, i = float64[::1], int64[::1]
    if gaps:
        prepare(
            [
                (gappy_clusters, (f, f, i, int64, int64, float64, f, f, i)),
                (gappy_integral, (f, i, int64, int64, f, i)),
            ]
        )
    else:
        prepare([(running_sum, (f, float64, f)), (second_differences, (f, i, int64, int64, f))])
