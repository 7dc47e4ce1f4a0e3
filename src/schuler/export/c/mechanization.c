/* Strapdown in Earth-fixed axes; the text of schuler.mechanization.kernels. */
#include "schuler_internal.h"

/* Normal gravity in Earth-fixed axes: a level ellipsoid's zonals to J6. */
void sch_gravity(const double r[3], sch_real g[3])
{
    const sch_real x = K(r[0]), y = K(r[1]), z = K(r[2]);
    const sch_real i2 = K(1.0) / (x * x + y * y + z * z);
    const sch_real s = z * z * i2;
    const sch_real t = K(EARTH_A * EARTH_A) * i2;
    const sch_real p2 = K(1.5 * 1.082629821313e-3) * t;
    const sch_real p4 = K(-0.625 * -2.3709112005322035e-06) * t * t;
    const sch_real p6 = K(0.0625 * 6.083464988811234e-09) * t * t * t;
    const sch_real c = K(-EARTH_GM) * i2 * SQRT(i2);
    const sch_real equatorial = K(1.0) + p2 * (K(1.0) - K(5.0) * s) + p4 * (K(3.0) - s * (K(42.0) - K(63.0) * s))
                                + p6 * (K(35.0) - s * (K(945.0) - s * (K(3465.0) - K(3003.0) * s)));
    const sch_real polar = K(1.0) + p2 * (K(3.0) - K(5.0) * s) + p4 * (K(15.0) - s * (K(70.0) - K(63.0) * s))
                           + p6 * (K(245.0) - s * (K(2205.0) - s * (K(4851.0) - K(3003.0) * s)));
    const sch_real k = c * equatorial + K(EARTH_RATE * EARTH_RATE);
    g[0] = k * x;
    g[1] = k * y;
    g[2] = c * polar * z;
}

/* Quadratic rate and force of an interval through its own increment and the two before it. */
void sch_fit_interval(sch_real poly[18], const sch_real now[6], const sch_real before[6], const sch_real earlier[6],
                      sch_real h, sch_real h1, sch_real h2)
{
    int i, o;
    if (h2 > 0 && FABS(h1 - h) < EQUAL_STEPS * h && FABS(h2 - h) < EQUAL_STEPS * h) {
        for (i = 0; i < 6; i++) {
            o = i < 3 ? i : i + 6;
            poly[o] = (K(2.0) * now[i] + K(5.0) * before[i] - earlier[i]) * K(1.0 / 6.0);
            poly[o + 3] = now[i] - before[i];
            poly[o + 6] = now[i] - K(2.0) * before[i] + earlier[i];
        }
    } else if (h1 > 0) { /* divided differences of the integrals */
        const sch_real u = K(1.0) / h, u1 = K(1.0) / h1, c = K(1.0) / (h + h1);
        sch_real u2 = 0, c1 = 0, c2 = 0;
        if (h2 > 0) {
            u2 = K(1.0) / h2;
            c1 = K(1.0) / (h1 + h2);
            c2 = K(1.0) / (h + h1 + h2);
        }
        for (i = 0; i < 6; i++) {
            const sch_real d2 = (now[i] * u - before[i] * u1) * c;
            const sch_real d3 = (d2 - (before[i] * u1 - earlier[i] * u2) * c1) * c2;
            o = i < 3 ? i : i + 6;
            poly[o] = now[i] - h * h * (d2 + h1 * d3);
            poly[o + 3] = K(2.0) * h * h * (d2 + (h1 - h) * d3);
            poly[o + 6] = K(6.0) * h * h * h * d3;
        }
    } else {
        for (i = 0; i < 6; i++) {
            o = i < 3 ? i : i + 6;
            poly[o] = now[i];
            poly[o + 3] = poly[o + 6] = 0;
        }
    }
}

/* The stretch from s0 to s1 of an interval, as the polynomial of its own unit interval. */
void sch_cut_interval(sch_real part[18], const sch_real poly[18], sch_real s0, sch_real s1)
{
    const sch_real ds = s1 - s0;
    int i;
    for (i = 0; i < 6; i++) {
        const int o = i < 3 ? i : i + 6;
        part[o] = (poly[o] + s0 * (poly[o + 3] + K(0.5) * s0 * poly[o + 6])) * ds;
        part[o + 3] = (poly[o + 3] + s0 * poly[o + 6]) * ds * ds;
        part[o + 6] = poly[o + 6] * ds * ds * ds;
    }
}

/* (1 - cos a) / a^2 and (a - sin a) / a^3, m = a^2: series when small, else closed form. */
static void rotation_coefficients(sch_real m, sch_real *g1, sch_real *g2)
{
    if (m < K(0.25)) {
        *g1 = K(0.5)
              - m * (K(1.0 / 24.0)
                     - m * (K(1.0 / 720.0) - m * (K(1.0 / 40320.0) - m * (K(1.0 / 3628800.0) - m / K(479001600.0)))));
        *g2 = K(1.0 / 6.0)
              - m * (K(1.0 / 120.0) - m * (K(1.0 / 5040.0) - m * (K(1.0 / 362880.0) - m / K(39916800.0))));
    } else {
        const sch_real angle = SQRT(m);
        *g1 = (K(1.0) - COS(angle)) / m;
        *g2 = (angle - SIN(angle)) / (m * angle);
    }
}

/* Cosine of half the angle of a rotation vector, and sine of half the angle divided by the angle. */
static void half_angle(const sch_real p[3], sch_real *c, sch_real *s)
{
    const sch_real x = K(0.25) * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    if (x < K(0.0625)) {
        *c = K(1.0) - x * (K(0.5) - x * (K(1.0 / 24.0) - x * (K(1.0 / 720.0) - x * (K(1.0 / 40320.0) - x / K(3628800.0)))));
        *s = K(0.5) - x * (K(1.0 / 12.0) - x * (K(1.0 / 240.0) - x * (K(1.0 / 10080.0) - x / K(725760.0))));
    } else {
        const sch_real half = SQRT(x);
        *c = COS(half);
        *s = K(0.5) * SIN(half) / half;
    }
}

static void cross(const sch_real a[3], const sch_real b[3], sch_real out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Rotation vector p, velocity change u and position shape term j of an interval, in body axes at its start. */
static void body_integrals(const sch_real poly[18], sch_real p[3], sch_real u[3], sch_real j[3])
{
    const sch_real *a0 = poly, *a1 = poly + 3, *a2 = poly + 6, *b0 = poly + 9, *b1 = poly + 12, *b2 = poly + 15;
    const sch_real c6 = K(1.0 / 6.0), c12 = K(1.0 / 12.0), c24 = K(1.0 / 24.0);
    sch_real t[3], d[3], k[3], l[3], f[3], g[3], e[3], hh[3], g1, g2;
    int i;
    for (i = 0; i < 3; i++) {
        t[i] = a0[i] + K(0.5) * a1[i] + c6 * a2[i];
        d[i] = b0[i] + K(0.5) * b1[i] + c6 * b2[i];
        k[i] = c12 * a1[i] + c24 * a2[i];
        l[i] = c12 * b1[i] + c24 * b2[i];
    }
    /* coning: a0 x (a1 / 12 + a2 / 24) */
    p[0] = t[0] + a0[1] * k[2] - a0[2] * k[1];
    p[1] = t[1] + a0[2] * k[0] - a0[0] * k[2];
    p[2] = t[2] + a0[0] * k[1] - a0[1] * k[0];
    cross(t, d, f); /* dtheta x dv, dtheta x (dtheta x dv) */
    cross(t, f, g);
    rotation_coefficients(t[0] * t[0] + t[1] * t[1] + t[2] * t[2], &g1, &g2);
    cross(a0, b1, e);
    cross(a0, b0, hh);
    for (i = 0; i < 3; i++) {
        const int m = (i + 1) % 3, n = (i + 2) % 3;
        /* sculling: a0 x (b1 / 12 + b2 / 24) + b0 x (a1 / 12 + a2 / 24) */
        const sch_real w = a0[m] * l[n] - a0[n] * l[m] + b0[m] * k[n] - b0[n] * k[m];
        /* fourth order: (a0 x (a0 x b1) - a1 x (a0 x b0)) / 24 */
        u[i] = d[i] + g1 * f[i] + g2 * g[i] + w + c24 * (a0[m] * e[n] - a0[n] * e[m] - a1[m] * hh[n] + a1[n] * hh[m]);
        /* derivative of the force in non-rotating axes, for the position integral */
        j[i] = b1[i] + K(0.5) * b2[i] + hh[i];
    }
}

/* The nine elements of the matrix of a quaternion, row by row. */
void sch_dcm(const sch_real q[4], sch_real c[9])
{
    const sch_real w = q[0], x = q[1], y = q[2], z = q[3];
    c[0] = w * w + x * x - y * y - z * z;
    c[1] = K(2.0) * (x * y - w * z);
    c[2] = K(2.0) * (x * z + w * y);
    c[3] = K(2.0) * (x * y + w * z);
    c[4] = w * w - x * x + y * y - z * z;
    c[5] = K(2.0) * (y * z - w * x);
    c[6] = K(2.0) * (x * z - w * y);
    c[7] = K(2.0) * (y * z + w * x);
    c[8] = w * w - x * x - y * y + z * z;
}

/* Attitude turned by a rotation vector in Earth-fixed axes: q <- exp(x, y, z) q. */
void sch_rotate_by(sch_real q[4], sch_real x, sch_real y, sch_real z)
{
    const sch_real p[3] = {x, y, z};
    const sch_real q0 = q[0], q1 = q[1], q2 = q[2], q3 = q[3];
    sch_real c, s;
    half_angle(p, &c, &s);
    x *= s;
    y *= s;
    z *= s;
    q[0] = c * q0 - x * q1 - y * q2 - z * q3;
    q[1] = c * q1 + x * q0 + y * q3 - z * q2;
    q[2] = c * q2 - x * q3 + y * q0 + z * q1;
    q[3] = c * q3 + x * q2 - y * q1 + z * q0;
}

/* Carry the navigation state over an interval of h seconds; d is the specific force integral in Earth-fixed axes. */
void sch_advance(sch_state *st, const sch_real poly[18], sch_real h, sch_real d[3])
{
    sch_real *q = st->q_eb, *v = st->v_eb_e;
    double *r = st->r_eb_e;
    sch_real p[3], u[3], j[3], c[9], g[3], w[3], cs, sn, sx, sy, sz, aw, ax, ay, az, bw, bx, by, bz, n;
    const sch_real qw = q[0], qx = q[1], qy = q[2], qz = q[3];
    const sch_real e = K(0.5) * K(SCH_OMEGA_IE) * h, hh = K(0.5) * h, k = h / K(12.0);
    const sch_real e2 = e * e, ce = K(1.0) - K(0.5) * e2 * (K(1.0) - e2 / K(12.0)), se = e * (K(1.0) - e2 / K(6.0));
    sch_real ix, iy, iz, mx, my;
    double mid[3];
    int i;
    body_integrals(poly, p, u, j);
    sch_dcm(q, c);
    /* specific force: body to Earth-fixed axes, which turn by 2 e meanwhile */
    for (i = 0; i < 3; i++)
        d[i] = c[3 * i] * u[0] + c[3 * i + 1] * u[1] + c[3 * i + 2] * u[2];
    for (i = 0; i < 3; i++)
        mid[i] = r[i] + (double)hh * (double)v[i];
    sch_gravity(mid, g);
    ix = d[0] + e * d[1] + g[0] * h;
    iy = d[1] - e * d[0] + g[1] * h;
    iz = d[2] + g[2] * h;
    mx = v[0] + K(0.5) * ix + K(2.0) * e * v[1]; /* mid-interval velocity for the Coriolis term */
    my = v[1] + K(0.5) * iy - K(2.0) * e * v[0];
    w[0] = v[0] + ix + K(4.0) * e * my;
    w[1] = v[1] + iy - K(4.0) * e * mx;
    w[2] = v[2] + iz;
    for (i = 0; i < 3; i++)
        r[i] += (double)(hh * (v[i] + w[i]) - k * (c[3 * i] * j[0] + c[3 * i + 1] * j[1] + c[3 * i + 2] * j[2]));
    for (i = 0; i < 3; i++)
        v[i] = w[i];
    half_angle(p, &cs, &sn);
    sx = sn * p[0];
    sy = sn * p[1];
    sz = sn * p[2];
    aw = qw * cs - qx * sx - qy * sy - qz * sz;
    ax = qw * sx + qx * cs + qy * sz - qz * sy;
    ay = qw * sy - qx * sz + qy * cs + qz * sx;
    az = qw * sz + qx * sy - qy * sx + qz * cs;
    bw = ce * aw + se * az;
    bx = ce * ax + se * ay;
    by = ce * ay - se * ax;
    bz = ce * az - se * aw;
    n = K(1.5) - K(0.5) * (bw * bw + bx * bx + by * by + bz * bz); /* first-order renormalisation */
    q[0] = n * bw;
    q[1] = n * bx;
    q[2] = n * by;
    q[3] = n * bz;
}
