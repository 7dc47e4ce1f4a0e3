"""Means, spreads and covariances of parts that can be put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray


@dataclass(frozen=True)
class Moments:
    """Number, mean and sums of powers of the deviations from it.

    Attributes
    ----------
    n : int
    mean, m2, m3, m4 : ndarray, shape (e,)
        ``m_k = sum (x - mean)^k``.
    low, high : ndarray, shape (e,)
        Smallest and largest.
    """

    n: int
    mean: FloatArray
    m2: FloatArray
    m3: FloatArray
    m4: FloatArray
    low: FloatArray
    high: FloatArray


def moments(x: FloatArray) -> Moments:
    """Moments over the first axis, at least one row. Shape (n, e)."""
    mean = x.mean(axis=0)
    d = x - mean
    squared = d * d
    return Moments(
        len(x), mean, squared.sum(axis=0), (squared * d).sum(axis=0), (squared * squared).sum(axis=0),
        x.min(axis=0), x.max(axis=0),
    )  # fmt: skip


def merged(a: Moments, b: Moments) -> Moments:
    """Moments of two parts together.

    References
    ----------
    Chan, Golub, LeVeque (1983), Am. Stat. 37:242 for the second; Pebay (2008), Sandia SAND2008-6212 for the others.
    """
    if not a.n or not b.n:
        return a if a.n else b
    p, q = float(a.n), float(b.n)
    n = p + q
    d = b.mean - a.mean
    e = d / n
    m2 = a.m2 + b.m2 + p * q * d * e
    m3 = a.m3 + b.m3 + p * q * (p - q) * d * e**2 + 3.0 * e * (p * b.m2 - q * a.m2)
    m4 = (
        a.m4 + b.m4 + p * q * (p * p - p * q + q * q) * d * e**3
        + 6.0 * e**2 * (p * p * b.m2 + q * q * a.m2) + 4.0 * e * (p * b.m3 - q * a.m3)
    )  # fmt: skip
    return Moments(a.n + b.n, a.mean + q * e, m2, m3, m4, np.minimum(a.low, b.low), np.maximum(a.high, b.high))


@dataclass(frozen=True)
class Products:
    """Number, mean, and sum of the outer products of deviations over the last axis.

    Attributes
    ----------
    n : int
    mean : ndarray, shape (..., m)
    C : ndarray, shape (..., m, m)
    """

    n: int
    mean: FloatArray
    C: FloatArray


def products(x: FloatArray) -> Products:
    """Products over the first axis, at least one row. Shape (n, ..., m)."""
    mean = x.mean(axis=0)
    d = x - mean
    return Products(len(x), mean, (d[..., :, None] * d[..., None, :]).sum(axis=0))


def merged_products(a: Products, b: Products) -> Products:
    """Products of two parts together (Chan, Golub, LeVeque 1983)."""
    if not a.n or not b.n:
        return a if a.n else b
    p, q = float(a.n), float(b.n)
    d = b.mean - a.mean
    C = a.C + b.C + (p * q / (p + q)) * d[..., :, None] * d[..., None, :]
    return Products(a.n + b.n, a.mean + (q / (p + q)) * d, C)
