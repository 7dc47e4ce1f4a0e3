"""Compiled sensor model of the filter: estimated errors as matrices, and raw increments compensated by them.

``sens[33]`` are the estimated sensor errors: b_g 3, b_a 3, inverse of I + M_g 9, of I + M_a 9, G_g 9. ``ptab[m, 3]``
says of each sensor parameter its sensor (0 gyro, 1 accelerometer), axis, and regressor (0 time, 1-3 force, 4-6 rate).
The text is compiled for numbers and for lanes.
"""

from __future__ import annotations

from schuler.jit import borrowing, inlined


@inlined
def invert3(M, out, o):
    """Inverse of a 3 x 3 matrix by cofactors, written row by row to ``out[o : o + 9]``."""
    c00 = M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1]
    c01 = M[1, 2] * M[2, 0] - M[1, 0] * M[2, 2]
    c02 = M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0]
    d = 1.0 / (M[0, 0] * c00 + M[0, 1] * c01 + M[0, 2] * c02)
    out[o], out[o + 3], out[o + 6] = d * c00, d * c01, d * c02
    out[o + 1] = d * (M[0, 2] * M[2, 1] - M[0, 1] * M[2, 2])
    out[o + 4] = d * (M[0, 0] * M[2, 2] - M[0, 2] * M[2, 0])
    out[o + 7] = d * (M[0, 1] * M[2, 0] - M[0, 0] * M[2, 1])
    out[o + 2] = d * (M[0, 1] * M[1, 2] - M[0, 2] * M[1, 1])
    out[o + 5] = d * (M[0, 2] * M[1, 0] - M[0, 0] * M[1, 2])
    out[o + 8] = d * (M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0])


@borrowing
def spread_estimates(est, ptab, n_sensor, M, sens):
    """Write the sensor parameters of ``est`` into ``sens``; matrices are inverted here, once per correction.

    ``M[2, 3, 3]`` is workspace.
    """
    for i in range(6):
        sens[i] = 0.0
    for i in range(9):
        sens[24 + i] = 0.0
    for a in range(2):
        for i in range(3):
            for j in range(3):
                M[a, i, j] = 1.0 if i == j else 0.0
    for k in range(n_sensor):
        gyro, i, source = ptab[k, 0] == 0, ptab[k, 1], ptab[k, 2]
        if source == 0:
            sens[i if gyro else 3 + i] += est[k]
        elif gyro and source >= 4:
            M[0, i, source - 4] += est[k]
        elif gyro:
            sens[24 + 3 * i + source - 1] += est[k]
        else:
            M[1, i, source - 1] += est[k]
    invert3(M[0], sens, 6)
    invert3(M[1], sens, 15)


@inlined
def compensate(poly, raw, sens, h, matrix):
    """Interval polynomial with the estimated sensor errors taken out: the exact inverse of the sensor model."""
    for i in range(18):
        poly[i] = raw[i]
    for i in range(3):
        poly[i] -= sens[i] * h
        poly[9 + i] -= sens[3 + i] * h
    if matrix:
        for o in range(3):
            x, y, z = poly[9 + 3 * o], poly[10 + 3 * o], poly[11 + 3 * o]
            x, y, z = (
                sens[15] * x + sens[16] * y + sens[17] * z,
                sens[18] * x + sens[19] * y + sens[20] * z,
                sens[21] * x + sens[22] * y + sens[23] * z,
            )
            poly[9 + 3 * o], poly[10 + 3 * o], poly[11 + 3 * o] = x, y, z
            p = poly[3 * o] - (sens[24] * x + sens[25] * y + sens[26] * z)
            q = poly[3 * o + 1] - (sens[27] * x + sens[28] * y + sens[29] * z)
            r = poly[3 * o + 2] - (sens[30] * x + sens[31] * y + sens[32] * z)
            poly[3 * o] = sens[6] * p + sens[7] * q + sens[8] * r
            poly[3 * o + 1] = sens[9] * p + sens[10] * q + sens[11] * r
            poly[3 * o + 2] = sens[12] * p + sens[13] * q + sens[14] * r
