"""Moving and block variances, sample by sample. Arrays are C-contiguous float64."""

from __future__ import annotations

from numba import float64, int64

from schuler.jit import kernel, prepare


@kernel
def moving_variance(x, W, sigma2, out):
    """Largest of out and the variance of x over W samples around each, relative to sigma2, mean of three axes.

    The sums start anew every W samples: what adding and subtracting loses to rounding stays that of one window.
    """
    n = x.shape[0]
    half = W // 2
    for j in range(3):
        scale = 1.0 / (3.0 * W * sigma2[j])
        s = 0.0
        q = 0.0
        origin = 0.0
        for a in range(n - W + 1):
            if a % W == 0:
                origin = x[a, j]
                s = 0.0
                q = 0.0
                for i in range(a, a + W):
                    d = x[i, j] - origin
                    s += d
                    q += d * d
            else:
                d = x[a + W - 1, j] - origin
                e = x[a - 1, j] - origin
                s += d - e
                q += d * d - e * e
            out[a + half, j] = max(q - s * s / W, 0.0) * scale


@kernel
def larger_triad(a, g, W, out):
    """The larger of the two triads' sums over axes; windows at the ends of the log count for what they cover."""
    n = a.shape[0]
    first = W // 2
    last = n - W + W // 2
    for i in range(n):
        k = min(max(i, first), last)
        out[i] = max(a[k, 0] + a[k, 1] + a[k, 2], g[k, 0] + g[k, 1] + g[k, 2])


@kernel
def block_variances(x, W, out):
    """Variance of x in consecutive blocks of W samples, per axis."""
    for k in range(out.shape[0]):
        for j in range(3):
            mean = 0.0
            for i in range(k * W, (k + 1) * W):
                mean += x[i, j]
            mean /= W
            total = 0.0
            for i in range(k * W, (k + 1) * W):
                d = x[i, j] - mean
                total += d * d
            out[k, j] = total / (W - 1)


def prepare_variances() -> None:
    """Compile or load the kernels, with a word to the user if that takes long."""
    f, m = float64[::1], float64[:, ::1]
    prepare([(moving_variance, (m, int64, f, m)), (larger_triad, (m, m, int64, f)), (block_variances, (m, int64, m))])
