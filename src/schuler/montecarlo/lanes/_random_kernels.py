"""Normal random numbers made in lanes: xoshiro256++ streams, Box and Muller's transformation.

A stream is 256 bits of state in each lane, ``state[4, LANES]`` (uint64), seeded from outside; what a lane draws depends
on its own state alone. Two draws of 64 bits make two normals: one is the squared radius ``-2 ln u``, u from 2^-52 to 1,
the other the angle, 52 bits for a quarter turn and two for which. Nothing is rejected, so all lanes keep step.
Logarithm, sine and cosine are polynomials with relative errors below 2e-16; the largest normal possible is 8.49.

Measured on one core: 0.9 ns a normal, against 3.6 for the inverse distribution function (Wichura's AS 241) in lanes, 8
for NumPy's ziggurat and 16 for a ziggurat lane by lane.

References
----------
Blackman and Vigna (2021), Scrambled linear pseudorandom number generators, ACM TOMS 47(4): xoshiro256++.
Box and Muller (1958), Ann. Math. Statist. 29(2).
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math

from schuler.filtering.kernels.vector import (
    add_bits,
    as_lanes,
    load_bits,
    negate_by_bit,
    one_to_two,
    rotate_left,
    shift_left,
    split_power,
    store_bits,
    swap_by_bit,
    xor_bits,
)
from schuler.jit import inlined, kernel

_LN2 = math.log(2.0)


@inlined
def box_muller(x, y):
    """Two independent standard normals in each lane from two draws of 64 bits."""
    m, e = split_power(2.0 - one_to_two(x))  # 0 < u <= 1
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    # atanh(s) / s
    p = 0.9999999999999999989 + z * (0.3333333333333382283 + z * (0.1999999999965116906 + z * (
        0.1428571438032083984 + z * (0.1111109852836302330 + z * (0.0909181584011466440 + z * (
            0.0765626407418209548 + z * 0.0740485518032763835))))))  # fmt: skip
    r = math.sqrt(-4.0 * (s * p) - (2.0 * _LN2) * e)
    f = one_to_two(y) - 1.5  # of a quarter turn, about the axis
    z = f * f
    b = r * f * (1.570796326794896614 + z * (-0.6459640975062443157 + z * (0.0796926262460430031 + z * (
        -0.0046817541323409760 + z * (1.604411507421909105e-4 + z * (
            -3.598643352982309702e-6 + z * 5.633933781537853954e-8))))))  # fmt: skip
    a = r * (1.0 + z * (-1.233700550136169812 + z * (0.2536695079010467091 + z * (-0.0208634807633112091 + z * (
        9.192602741831557208e-4 + z * (-2.520203677096046026e-5 + z * (
            4.710610072675782302e-7 - z * 6.321256869628588411e-9)))))))  # fmt: skip
    return swap_by_bit(y, 0, negate_by_bit(y, 1, a), b)


@inlined
def normals(state, out, pairs):
    """Draw ``2 * pairs`` standard normals in each lane, to the rows of ``out`` (lanes)."""
    s0, s1, s2, s3 = load_bits(state, 0), load_bits(state, 1), load_bits(state, 2), load_bits(state, 3)
    for k in range(pairs):
        x = add_bits(rotate_left(add_bits(s0, s3), 23), s0)
        t = shift_left(s1, 17)
        s2, s3 = xor_bits(s2, s0), xor_bits(s3, s1)
        s1, s0 = xor_bits(s1, s2), xor_bits(s0, s3)
        s2, s3 = xor_bits(s2, t), rotate_left(s3, 45)
        y = add_bits(rotate_left(add_bits(s0, s3), 23), s0)
        t = shift_left(s1, 17)
        s2, s3 = xor_bits(s2, s0), xor_bits(s3, s1)
        s1, s0 = xor_bits(s1, s2), xor_bits(s0, s3)
        s2, s3 = xor_bits(s2, t), rotate_left(s3, 45)
        out[2 * k], out[2 * k + 1] = box_muller(x, y)
    store_bits(state, 0, s0)
    store_bits(state, 1, s1)
    store_bits(state, 2, s2)
    store_bits(state, 3, s3)


@kernel
def draw(state, out):
    """Fill ``out`` (an even number of rows, LANES) with standard normals."""
    normals(state, as_lanes(out), out.shape[0] // 2)
