/* Rows of H, innovation, correction and feedback; the text of schuler.filtering.kernels: update and vehicle. */
#include "schuler_internal.h"

/* North, east, down unit vectors at an Earth-fixed position as rows of U (one of Bowring's steps). */
void sch_ned_axes(const double r[3], sch_real U[3][3])
{
    const sch_real x = K(r[0]), y = K(r[1]), z = K(r[2]), a = K(EARTH_A), b = K(EARTH_B), e2 = K(EARTH_E2);
    const sch_real p = SQRT(x * x + y * y);
    sch_real t = SQRT(a * a * z * z + b * b * p * p);
    const sch_real sb = a * z / t, cb = b * p / t;
    const sch_real S = z + e2 / (K(1.0) - e2) * b * sb * sb * sb, C = p - e2 * a * cb * cb * cb;
    const sch_real cl = p > 0 ? x / p : K(1.0), sl = p > 0 ? y / p : K(0.0); /* at the poles, longitude zero */
    sch_real sL, cL;
    t = SQRT(S * S + C * C);
    sL = S / t;
    cL = C / t;
    U[0][0] = -sL * cl;
    U[0][1] = -sL * sl;
    U[0][2] = cL;
    U[1][0] = -sl;
    U[1][1] = cl;
    U[1][2] = 0;
    U[2][0] = -cL * cl;
    U[2][1] = -cL * sl;
    U[2][2] = -sL;
}

/* Lever arm in body axes with the estimate of its error, whose three states begin at i_lever (-1: none). */
static void estimated_lever(const sch_state *s, const sch_real lever[3], int i_lever, sch_real l[3])
{
    int i;
    for (i = 0; i < 3; i++)
        l[i] = i_lever >= 0 ? lever[i] + s->est[i_lever - 9 + i] : lever[i];
}

static void turned_by(const sch_real c[9], const sch_real x[3], sch_real out[3])
{
    int i;
    for (i = 0; i < 3; i++)
        out[i] = c[3 * i] * x[0] + c[3 * i + 1] * x[1] + c[3 * i + 2] * x[2];
}

/* Mean angular rate of the present interval, body axes; returns one over its length. */
static sch_real mean_rate(const sch_state *s, sch_real w[3])
{
    const sch_real k = s->reg[0] > 0 ? K(1.0) / s->reg[0] : K(0.0);
    int i;
    for (i = 0; i < 3; i++)
        w[i] = k * s->reg[4 + i];
    return k;
}

/* Add a Gauss-Markov error of the receiver to component i of a measurement (-1: not estimated). */
static void correlated_error(sch_state *s, int i, int i_error)
{
    if (i_error >= 0) {
        s->work.y[i] += s->est[i_error - 9 + i];
        s->work.H[i][i_error + i] = K(1.0);
    }
}

/* Add to row i what errors of sensor parameters do to t . omega_ib_b; k is one over the interval. */
static void rate_columns(sch_state *s, int i, const sch_real t[3], sch_real k)
{
    const sch_real *sens = s->sens;
    sch_real *H = s->work.H[i] + 9;
    int j;
    for (j = 0; j < SCH_N_SENSOR; j++) {
        const int a = sch_table[j].axis, source = sch_table[j].source;
        const sch_real r = source == 0 ? K(1.0) : k * s->reg[source];
        if (sch_table[j].sensor == 0) {
            H[j] -= r * (sens[6 + a] * t[0] + sens[9 + a] * t[1] + sens[12 + a] * t[2]);
        } else if (SCH_CROSS) {
            const sch_real f[3] = {sens[15 + a], sens[18 + a], sens[21 + a]};
            sch_real p[3], g[3];
            turned_by(sens + 24, f, p);
            turned_by(sens + 6, p, g);
            H[j] += r * (g[0] * t[0] + g[1] * t[1] + g[2] * t[2]);
        }
    }
}

/* Position of an antenna, north, east, down: r + C l + delay v. */
static void position_rows(sch_state *s, const sch_measurement *m, int i_lever, int i_error, int i_delay)
{
    sch_real c[9], l[3], L[3], d[3];
    int a, i;
    estimated_lever(s, m->lever, i_lever, l);
    sch_dcm(s->q_eb, c);
    turned_by(c, l, L);
    for (i = 0; i < 3; i++)
        d[i] = K(s->r_eb_e[i] + (double)L[i] - m->z[i]);
    for (i = 0; i < 3; i++) {
        const sch_real *u = s->work.U[i], *v = s->v_eb_e;
        sch_real *H = s->work.H[i];
        H[0] = L[1] * u[2] - L[2] * u[1];
        H[1] = L[2] * u[0] - L[0] * u[2];
        H[2] = L[0] * u[1] - L[1] * u[0];
        H[6] = u[0];
        H[7] = u[1];
        H[8] = u[2];
        if (i_lever >= 0)
            for (a = 0; a < 3; a++)
                H[i_lever + a] = u[0] * c[a] + u[1] * c[3 + a] + u[2] * c[6 + a];
        s->work.y[i] = u[0] * d[0] + u[1] * d[1] + u[2] * d[2];
        if (i_delay >= 0) { /* the fix belongs to a time later by the delay than its stamp says */
            const sch_real delay = s->est[i_delay - 9], speed = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
            s->work.y[i] += delay * speed;
            H[i_delay] = speed;
            H[3] = delay * u[0];
            H[4] = delay * u[1];
            H[5] = delay * u[2];
        }
        correlated_error(s, i, i_error);
    }
}

/* Add to a velocity what changes over the receiver's delay: specific force, gravity, Coriolis acceleration. */
static void delayed_velocity(sch_state *s, const sch_real c[9], sch_real k, int i_delay)
{
    const sch_real omega = K(SCH_OMEGA_IE), delay = s->est[i_delay - 9];
    const sch_real force[3] = {k * s->reg[1], k * s->reg[2], k * s->reg[3]};
    sch_real f[3], a[3];
    int i;
    turned_by(c, force, f);
    sch_gravity(s->r_eb_e, a);
    a[0] = a[0] + f[0] + K(2.0) * omega * s->v_eb_e[1];
    a[1] = a[1] + f[1] - K(2.0) * omega * s->v_eb_e[0];
    a[2] = a[2] + f[2];
    for (i = 0; i < 3; i++) {
        const sch_real *u = s->work.U[i];
        const sch_real acceleration = u[0] * a[0] + u[1] * a[1] + u[2] * a[2];
        sch_real *H = s->work.H[i];
        s->work.y[i] += delay * acceleration;
        H[i_delay] = acceleration;
        H[0] += delay * (f[1] * u[2] - f[2] * u[1]);
        H[1] += delay * (f[2] * u[0] - f[0] * u[2]);
        H[2] += delay * (f[0] * u[1] - f[1] * u[0]);
        H[3] -= K(2.0) * omega * delay * u[1];
        H[4] += K(2.0) * omega * delay * u[0];
    }
}

/* Velocity of an antenna, or of a point that rests, north, east, down: v + C (omega_ib x l) - omega_ie x (C l) + delay a. */
static void velocity_rows(sch_state *s, const sch_measurement *m, int i_lever, int i_error, int i_delay)
{
    const sch_real omega = K(SCH_OMEGA_IE);
    sch_real c[9], l[3], L[3], w[3], x[3], M[3], v[3], k;
    int i, has_lever;
    estimated_lever(s, m->lever, i_lever, l);
    sch_dcm(s->q_eb, c);
    turned_by(c, l, L);
    k = mean_rate(s, w);
    for (i = 0; i < 3; i++)
        x[i] = w[(i + 1) % 3] * l[(i + 2) % 3] - w[(i + 2) % 3] * l[(i + 1) % 3];
    turned_by(c, x, M);
    v[0] = s->v_eb_e[0] + M[0] + omega * L[1];
    v[1] = s->v_eb_e[1] + M[1] - omega * L[0];
    v[2] = s->v_eb_e[2] + M[2];
    has_lever = l[0] != 0 || l[1] != 0 || l[2] != 0;
    for (i = 0; i < 3; i++) {
        const sch_real *u = s->work.U[i];
        const sch_real e0 = -omega * u[1], e1 = omega * u[0]; /* omega_ie x u */
        sch_real *H = s->work.H[i], t[3];
        int a;
        s->work.y[i] = u[0] * v[0] + u[1] * v[1] + u[2] * v[2] - K(m->z[i]);
        H[3] = u[0];
        H[4] = u[1];
        H[5] = u[2];
        H[0] = M[1] * u[2] - M[2] * u[1] - L[2] * e1;
        H[1] = M[2] * u[0] - M[0] * u[2] + L[2] * e0;
        H[2] = M[0] * u[1] - M[1] * u[0] + L[0] * e1 - L[1] * e0;
        for (a = 0; a < 3; a++)
            t[a] = u[0] * c[a] + u[1] * c[3 + a] + u[2] * c[6 + a];
        if (i_lever >= 0) { /* C [omega x] - [omega_ie x] C */
            H[i_lever] = t[1] * w[2] - t[2] * w[1] + (e0 * c[0] + e1 * c[3]);
            H[i_lever + 1] = t[2] * w[0] - t[0] * w[2] + (e0 * c[1] + e1 * c[4]);
            H[i_lever + 2] = t[0] * w[1] - t[1] * w[0] + (e0 * c[2] + e1 * c[5]);
        }
        if (has_lever) {
            const sch_real turn[3] = {l[1] * t[2] - l[2] * t[1], l[2] * t[0] - l[0] * t[2], l[0] * t[1] - l[1] * t[0]};
            rate_columns(s, i, turn, k);
        }
        correlated_error(s, i, i_error);
    }
    if (i_delay >= 0)
        delayed_velocity(s, c, k, i_delay);
}

/* One component of the velocity over ground of a point of the vehicle, in the vehicle's axes: 0 forward, the odometer's
 * (1 + s) v_x; 1 across; 2 down. */
static void vehicle_velocity(sch_state *s, const sch_measurement *m, int axis, int i_mount, int i_scale, int i_lever)
{
    const sch_real omega = K(SCH_OMEGA_IE), *v = s->v_eb_e;
    sch_real c[9], l[3], w[3], b[3], mm[3], u[3], turn[3], e0, e1, k, value, scale = K(1.0);
    sch_real pitch = 0, yaw = 0, sp, cp, sy, cy, a[3], p[3], q[3], *H = s->work.H[0];
    int i;
    estimated_lever(s, m->lever, i_lever, l);
    sch_dcm(s->q_eb, c);
    k = mean_rate(s, w);
    for (i = 0; i < 3; i++)
        w[i] = w[i] - c[6 + i] * omega; /* rate over ground, body axes: omega_ib - C' omega_ie */
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, n = (i + 2) % 3;
        b[i] = c[i] * v[0] + c[3 + i] * v[1] + c[6 + i] * v[2] + w[j] * l[n] - w[n] * l[j];
    }
    if (i_mount >= 0) {
        pitch = s->est[i_mount - 9];
        yaw = s->est[i_mount - 8];
    }
    sp = SIN(pitch);
    cp = COS(pitch);
    sy = SIN(yaw);
    cy = COS(yaw);
    /* the vehicle's axis in the body, and its derivatives with pitch (p) and yaw (q) */
    if (axis == 0) {
        a[0] = cy * cp, a[1] = -sy, a[2] = cy * sp;
        p[0] = -cy * sp, p[1] = 0, p[2] = cy * cp;
        q[0] = -sy * cp, q[1] = -cy, q[2] = -sy * sp;
    } else if (axis == 1) {
        a[0] = sy * cp, a[1] = cy, a[2] = sy * sp;
        p[0] = -sy * sp, p[1] = 0, p[2] = sy * cp;
        q[0] = cy * cp, q[1] = -sy, q[2] = cy * sp;
    } else {
        a[0] = -sp, a[1] = 0, a[2] = cp;
        p[0] = -cp, p[1] = 0, p[2] = -sp;
        q[0] = q[1] = q[2] = 0;
    }
    value = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    if (axis == 0 && i_scale >= 0) {
        scale += s->est[i_scale - 9];
        H[i_scale] = value;
    }
    s->work.y[0] = scale * value - K(m->z[0]);
    turned_by(c, a, u);
    for (i = 0; i < 3; i++)
        H[3 + i] = u[i] = scale * u[i];
    /* mm = l x a: the rate enters as omega . mm, and its part C' omega_ie turns with psi */
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, n = (i + 2) % 3;
        mm[i] = scale * (l[j] * a[n] - l[n] * a[j]);
        turn[i] = scale * (a[j] * w[n] - a[n] * w[j]);
    }
    e0 = c[0] * mm[0] + c[1] * mm[1] + c[2] * mm[2];
    e1 = c[3] * mm[0] + c[4] * mm[1] + c[5] * mm[2];
    H[0] = u[1] * v[2] - u[2] * v[1] - e1 * omega;
    H[1] = u[2] * v[0] - u[0] * v[2] + e0 * omega;
    H[2] = u[0] * v[1] - u[1] * v[0];
    rate_columns(s, 0, mm, k);
    if (i_lever >= 0)
        for (i = 0; i < 3; i++)
            H[i_lever + i] = turn[i];
    if (i_mount >= 0) {
        H[i_mount] = scale * (p[0] * b[0] + p[1] * b[1] + p[2] * b[2]);
        H[i_mount + 1] = scale * (q[0] * b[0] + q[1] * b[1] + q[2] * b[2]);
    }
}

/* Rows of H and the difference y, predicted minus measured; returns how many. */
int sch_measurement_rows(sch_state *s, const sch_measurement *m)
{
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < SCH_N; j++)
            s->work.H[i][j] = 0;
    sch_ned_axes(s->r_eb_e, s->work.U);
    switch (m->kind) {
    case SCH_POSITION:
        position_rows(s, m, SCH_AT_LEVER, SCH_AT_B_R, SCH_AT_DELAY);
        return 3;
    case SCH_VELOCITY:
        velocity_rows(s, m, SCH_AT_LEVER, SCH_AT_B_V, SCH_AT_DELAY);
        return 3;
    case SCH_ZERO_VELOCITY:
        velocity_rows(s, m, SCH_AT_LEVER_V, -1, -1);
        return 3;
    case SCH_LATERAL:
        vehicle_velocity(s, m, 1, SCH_AT_MOUNT, SCH_AT_ODOMETER, SCH_AT_LEVER_V);
        return 1;
    case SCH_VERTICAL:
        vehicle_velocity(s, m, 2, SCH_AT_MOUNT, SCH_AT_ODOMETER, SCH_AT_LEVER_V);
        return 1;
    default:
        vehicle_velocity(s, m, 0, SCH_AT_MOUNT, SCH_AT_ODOMETER, SCH_AT_LEVER_V);
        return 1;
    }
}

/* Whitened innovation of a measurement of d components; the state is not changed yet.
 *
 * S = H P H' + R = L L', W = L^-1 H P, e = L^-1 y. The update is then dx = W' e, P - W' W, and the normalised innovation
 * squared, which is returned, e . e; -1 if S is not positive definite. */
sch_real sch_innovate(sch_state *s, const sch_real R[9], int d)
{
    sch_real(*W)[SCH_N] = s->work.W, (*S)[3] = s->work.S, *e = s->work.e, L[3][3], nis = 0, v;
    int a, b, i, j, k;
    for (a = 0; a < d; a++) {
        for (j = 0; j < SCH_N; j++)
            W[a][j] = 0;
        for (i = 0; i < SCH_N; i++) {
            const sch_real h = s->work.H[a][i];
            if (h != 0)
                for (j = 0; j < SCH_N; j++)
                    W[a][j] += h * s->P[i][j];
        }
    }
    for (a = 0; a < d; a++)
        for (b = 0; b <= a; b++) {
            v = R[3 * a + b];
            for (i = 0; i < SCH_N; i++)
                v += s->work.H[a][i] * W[b][i];
            S[a][b] = S[b][a] = v;
        }
    for (a = 0; a < d; a++)
        for (b = 0; b <= a; b++) {
            v = S[a][b];
            for (k = 0; k < b; k++)
                v -= L[a][k] * L[b][k];
            if (a == b) {
                if (!(v > 0))
                    return K(-1.0);
                L[a][a] = SQRT(v);
            } else {
                L[a][b] = v / L[b][b];
            }
        }
    for (a = 0; a < d; a++) {
        v = s->work.y[a];
        for (b = 0; b < a; b++) {
            v -= L[a][b] * e[b];
            for (j = 0; j < SCH_N; j++)
                W[a][j] -= L[a][b] * W[b][j];
        }
        v *= K(1.0) / L[a][a];
        e[a] = v;
        for (j = 0; j < SCH_N; j++)
            W[a][j] *= K(1.0) / L[a][a];
        nis += v * v;
    }
    return nis;
}

/* Apply the update: P -= W' W (symmetric to the last bit) and closed-loop feedback of dx = W' e. */
void sch_correct(sch_state *s, int d)
{
    sch_real dx[SCH_N] = {0};
    int a, i, j;
    for (a = 0; a < d; a++) {
        const sch_real *w = s->work.W[a];
        for (j = 0; j < SCH_N; j++)
            dx[j] += s->work.e[a] * w[j];
        for (i = 0; i < SCH_N; i++) {
            const sch_real k = w[i];
            for (j = 0; j < SCH_N; j++)
                s->P[i][j] -= k * w[j];
        }
    }
    sch_rotate_by(s->q_eb, -dx[0], -dx[1], -dx[2]);
    for (i = 0; i < 3; i++) {
        s->v_eb_e[i] -= dx[3 + i];
        s->r_eb_e[i] -= (double)dx[6 + i];
    }
    for (i = 9; i < SCH_N; i++)
        s->est[i - 9] -= dx[i];
}
