/* Propagation of the covariance, P <- Phi P Phi' + Q, over the transition that samples since the last one add up to.
 * The text of schuler.filtering.kernels: sensor_errors, accumulation, covariance, and `propagate` of run. */
#include "schuler_internal.h"

/* Columns of `past`: integrals of the regressors (time, force, rate), time and force once more times mid time, attitude at
 * mid interval row by row, its columns x a_mid, and x b_mid. */
enum { PAST_T = 7, PAST_C = 11, PAST_A = 20, PAST_B = 29 };

static void invert3(sch_real M[3][3], sch_real *out)
{
    const sch_real c00 = M[1][1] * M[2][2] - M[1][2] * M[2][1];
    const sch_real c01 = M[1][2] * M[2][0] - M[1][0] * M[2][2];
    const sch_real c02 = M[1][0] * M[2][1] - M[1][1] * M[2][0];
    const sch_real d = K(1.0) / (M[0][0] * c00 + M[0][1] * c01 + M[0][2] * c02);
    out[0] = d * c00;
    out[3] = d * c01;
    out[6] = d * c02;
    out[1] = d * (M[0][2] * M[2][1] - M[0][1] * M[2][2]);
    out[4] = d * (M[0][0] * M[2][2] - M[0][2] * M[2][0]);
    out[7] = d * (M[0][1] * M[2][0] - M[0][0] * M[2][1]);
    out[2] = d * (M[0][1] * M[1][2] - M[0][2] * M[1][1]);
    out[5] = d * (M[0][2] * M[1][0] - M[0][0] * M[1][2]);
    out[8] = d * (M[0][0] * M[1][1] - M[0][1] * M[1][0]);
}

/* Write the sensor parameters of the estimate into sens: b_g 3, b_a 3, inverse of I + M_g 9, of I + M_a 9, G_g 9. */
void sch_spread_estimates(const sch_real *est, sch_real sens[33])
{
    sch_real M[2][3][3];
    int a, i, j, k;
    for (i = 0; i < 6; i++)
        sens[i] = 0;
    for (i = 0; i < 9; i++)
        sens[24 + i] = 0;
    for (a = 0; a < 2; a++)
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++)
                M[a][i][j] = i == j ? K(1.0) : K(0.0);
    for (k = 0; k < SCH_N_SENSOR; k++) {
        const int gyro = sch_table[k].sensor == 0, source = sch_table[k].source;
        i = sch_table[k].axis;
        if (source == 0)
            sens[gyro ? i : 3 + i] += est[k];
        else if (gyro && source >= 4)
            M[0][i][source - 4] += est[k];
        else if (gyro)
            sens[24 + 3 * i + source - 1] += est[k];
        else
            M[1][i][source - 1] += est[k];
    }
    invert3(M[0], sens + 6);
    invert3(M[1], sens + 15);
}

static void times3(const sch_real *m, const sch_real x[3], sch_real out[3])
{
    int i;
    for (i = 0; i < 3; i++)
        out[i] = m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2];
}

/* Interval polynomial with the estimated sensor errors taken out: the exact inverse of the sensor model. */
void sch_compensate(sch_real poly[18], const sch_real raw[18], const sch_real sens[33], sch_real h)
{
    int i, o;
    for (i = 0; i < 18; i++)
        poly[i] = raw[i];
    for (i = 0; i < 3; i++) {
        poly[i] -= sens[i] * h;
        poly[9 + i] -= sens[3 + i] * h;
    }
    if (SCH_RESPONSE)
        for (o = 0; o < 3; o++) {
            sch_real f[3], g[3], w[3];
            times3(sens + 15, poly + 9 + 3 * o, f);
            times3(sens + 24, f, g);
            for (i = 0; i < 3; i++) {
                poly[9 + 3 * o + i] = f[i];
                g[i] = poly[3 * o + i] - g[i];
            }
            times3(sens + 6, g, w);
            for (i = 0; i < 3; i++)
                poly[3 * o + i] = w[i];
        }
}

/* Integrals of force and rate over an interval, to reg[1..6]. */
void sch_regressor_integrals(const sch_real poly[18], sch_real reg[7])
{
    int i;
    for (i = 0; i < 3; i++) {
        reg[1 + i] = poly[9 + i] + K(0.5) * poly[12 + i] + poly[15 + i] / K(6.0);
        reg[4 + i] = poly[i] + K(0.5) * poly[3 + i] + poly[6 + i] / K(6.0);
    }
}

/* Store what the transition needs of an interval, and extend its sums; the navigation state is advanced already. */
void sch_store_interval(sch_state *s, const sch_real d[3], const sch_real poly[18], sch_real h)
{
    sch_real *row = s->past[s->n_past], *acc = s->acc, *reg = s->reg;
    sch_real c[9], a[3], b[3], X[3][3], hx, hy, hz, t, ht;
    const sch_real hh = K(0.5) * h;
    int i;
    sch_dcm(s->q_eb, c);
    reg[0] = h;
    sch_regressor_integrals(poly, reg);
    t = acc[0] + hh;
    for (i = 0; i < 7; i++)
        row[i] = reg[i];
    for (i = 0; i < 4; i++)
        row[PAST_T + i] = t * reg[i];
    /* C at mid interval: turned back by half the increment, to first order */
    hx = K(-0.5) * reg[4];
    hy = K(-0.5) * reg[5];
    hz = K(-0.5) * reg[6];
    ht = K(0.5) * t;
    for (i = 0; i < 3; i++) {
        const sch_real *k = c + 3 * i;
        a[i] = acc[2 + i] + K(0.5) * d[i];
        b[i] = s->moment[i] + ht * d[i];
        X[i][0] = k[0] + k[1] * hz - k[2] * hy;
        X[i][1] = k[1] + k[2] * hx - k[0] * hz;
        X[i][2] = k[2] + k[0] * hy - k[1] * hx;
    }
    for (i = 0; i < 3; i++) {
        const int m = (i + 1) % 3, n = (i + 2) % 3;
        int j;
        for (j = 0; j < 3; j++) {
            row[PAST_C + 3 * i + j] = X[i][j];
            row[PAST_A + 3 * i + j] = X[m][j] * a[n] - X[n][j] * a[m];
            row[PAST_B + 3 * i + j] = X[m][j] * b[n] - X[n][j] * b[m];
        }
    }
    for (i = 0; i < 3; i++)
        s->moment[i] += t * d[i];
    for (i = 0; i < 3; i++)
        acc[5 + i] += h * acc[2 + i] + hh * d[i];
    for (i = 0; i < 3; i++)
        acc[2 + i] += d[i];
    acc[0] += h;
    acc[1] += SQRT(reg[4] * reg[4] + reg[5] * reg[5] + reg[6] * reg[6]);
    s->n_past++;
}

/* out[source .. source + count - 1]: columns from `from` on of the past, times the nine from `to` on. */
static void sum_source(const sch_state *s, int source, int count, int from, int to, sch_real out[7][9])
{
    int a, j, t;
    for (a = 0; a < count; a++)
        for (j = 0; j < 9; j++) {
            sch_real sum = 0;
            for (t = 0; t < s->n_past; t++)
                sum += s->past[t][from + a] * s->past[t][to + j];
            out[source + a][j] = sum;
        }
}

/* Column i of a summed matrix times the inverse k of a sensor's response. */
static void column(sch_real X[7][9], int source, int i, const sch_real *k, int response, sch_real out[3])
{
    const sch_real *x = X[source];
    int r;
    for (r = 0; r < 3; r++)
        out[r] = response ? x[3 * r] * k[i] + x[3 * r + 1] * k[3 + i] + x[3 * r + 2] * k[6 + i] : x[3 * r + i];
}

/* Parameter columns B of the transition, from what was kept of the intervals. */
static void parameter_columns(sch_state *s)
{
    sch_real(*X)[9] = s->work.sums[0], (*XT)[9] = s->work.sums[1], (*XA)[9] = s->work.sums[2], (*XB)[9] = s->work.sums[3];
    const sch_real *sens = s->sens, *a = s->acc + 2, *b = s->moment, T = s->acc[0];
    sch_real N[9] = {0};
    int accel = 0, by_force = 0, by_rate = 0, gyro_by_force = 0, k, r, source;
    for (k = 0; k < SCH_N_SENSOR; k++) {
        const int force = sch_table[k].source >= 1 && sch_table[k].source <= 3;
        accel |= sch_table[k].sensor == 1;
        by_force |= force;
        by_rate |= sch_table[k].source >= 4;
        gyro_by_force |= force && sch_table[k].sensor == 0;
    }
    for (source = 0; source <= 4; source += source == 0 ? 1 : 3) {
        const int count = source == 0 ? 1 : 3;
        if ((source == 1 && !by_force) || (source == 4 && !by_rate))
            continue;
        sum_source(s, source, count, source, PAST_C, X);
        if (source != 4 && accel)
            sum_source(s, source, count, PAST_T + source, PAST_C, XT);
        if (source != 1 || gyro_by_force || SCH_CROSS) {
            sum_source(s, source, count, source, PAST_A, XA);
            sum_source(s, source, count, source, PAST_B, XB);
        }
    }
    if (SCH_CROSS) /* N = (I + M_g)^-1 G_g (I + M_a)^-1 */
        for (k = 0; k < 3; k++) {
            sch_real g[3];
            for (r = 0; r < 3; r++)
                g[r] = sens[24 + 3 * r] * sens[15 + k] + sens[25 + 3 * r] * sens[18 + k] + sens[26 + 3 * r] * sens[21 + k];
            for (r = 0; r < 3; r++)
                N[3 * r + k] = sens[6 + 3 * r] * g[0] + sens[7 + 3 * r] * g[1] + sens[8 + 3 * r] * g[2];
        }
    for (k = 0; k < SCH_N_SENSOR; k++) {
        const int i = sch_table[k].axis, is_gyro = sch_table[k].sensor == 0;
        sch_real p[3] = {0}, v[3] = {0}, w[3] = {0}, x[3], y[3], z[3];
        source = sch_table[k].source;
        if (!is_gyro) {
            column(X, source, i, sens + 15, SCH_RESPONSE, x);
            column(XT, source, i, sens + 15, SCH_RESPONSE, y);
            for (r = 0; r < 3; r++) {
                v[r] = -x[r];
                w[r] = -y[r];
            }
        }
        if (is_gyro || SCH_CROSS) {
            const sch_real *response = is_gyro ? sens + 6 : N;
            const int full = is_gyro ? SCH_RESPONSE : 1;
            column(X, source, i, response, full, p);
            column(XA, source, i, response, full, y);
            column(XB, source, i, response, full, z);
            if (is_gyro)
                for (r = 0; r < 3; r++) {
                    p[r] = -p[r];
                    y[r] = -y[r];
                    z[r] = -z[r];
                }
            for (r = 0; r < 3; r++) {
                const int m = (r + 1) % 3, n = (r + 2) % 3;
                v[r] += p[m] * a[n] - p[n] * a[m] - y[r];
                w[r] += p[m] * b[n] - p[n] * b[m] - z[r];
            }
        }
        for (r = 0; r < 3; r++) {
            s->work.B[k][r] = p[r];
            s->work.B[k][3 + r] = v[r];
            s->work.B[k][6 + r] = T * v[r] - w[r];
        }
    }
}

/* The 9 x 9 navigation block of the transition; elements that are always zero are never touched. */
static void transition(sch_state *s)
{
    sch_real(*A)[9] = s->work.A;
    const sch_real omega = K(SCH_OMEGA_IE), *acc = s->acc, T = acc[0], w = omega * T, o = K(2.0) * omega;
    const sch_real x = acc[2], y = acc[3], z = acc[4], p = acc[5], q = acc[6], r = acc[7];
    const sch_real i = omega * (T * x - p), j = omega * (T * y - q), k = omega * (T * z - r);
    const sch_real rx = K(s->r_eb_e[0]), ry = K(s->r_eb_e[1]), rz = K(s->r_eb_e[2]);
    const sch_real i2 = K(1.0) / (rx * rx + ry * ry + rz * rz);
    const sch_real g = T * K(EARTH_GM) * i2 * SQRT(i2), m = K(3.0) * g * i2;
    const sch_real c = T * K(EARTH_RATE * EARTH_RATE) - g, h = K(0.5) * T;
    const sch_real xx = m * rx * rx + c, yy = m * ry * ry + c, zz = m * rz * rz - g;
    const sch_real xy = m * rx * ry, xz = m * rx * rz, yz = m * ry * rz;
    A[0][0] = A[1][1] = K(1.0) - K(0.5) * w * w;
    A[0][1] = w;
    A[1][0] = -w;
    /* -[a x] and -[s x] of the sums of velocity increments, with Coriolis after and the turn of the axes before them */
    A[3][0] = -k - o * r;
    A[3][1] = z;
    A[3][2] = -y + o * p;
    A[4][0] = -z;
    A[4][1] = -k - o * r;
    A[4][2] = x + o * q;
    A[5][0] = y + i;
    A[5][1] = -x + j;
    A[6][1] = r;
    A[6][2] = -q;
    A[7][0] = -r;
    A[7][2] = p;
    A[8][0] = q;
    A[8][1] = -p;
    A[3][3] = A[4][4] = K(1.0) - K(2.0) * w * w;
    A[3][4] = K(2.0) * w;
    A[4][3] = K(-2.0) * w;
    A[5][5] = K(1.0);
    A[6][3] = A[7][4] = A[8][5] = T;
    A[6][4] = w * T;
    A[7][3] = -w * T;
    A[3][6] = xx;
    A[3][7] = A[4][6] = xy;
    A[3][8] = A[5][6] = xz;
    A[4][7] = yy;
    A[4][8] = A[5][7] = yz;
    A[5][8] = zz;
    A[6][6] = K(1.0) + h * xx;
    A[7][7] = K(1.0) + h * yy;
    A[8][8] = K(1.0) + h * zz;
    A[6][7] = A[7][6] = h * xy;
    A[6][8] = A[8][6] = h * xz;
    A[7][8] = A[8][7] = h * yz;
}

/* One navigation column x of nine elements through the transition, to column c of rows; zeros are left out. */
static void apply_navigation(sch_real A[9][9], const sch_real x[9], sch_real y[9])
{
    const sch_real p = x[0], q = x[1], r = x[2], e = x[3], f = x[4], g = x[5], u = x[6], v = x[7], z = x[8];
    y[0] = A[0][0] * p + A[0][1] * q;
    y[1] = A[1][0] * p + A[1][1] * q;
    y[2] = r;
    y[3] = A[3][0] * p + A[3][1] * q + A[3][2] * r + A[3][3] * e + A[3][4] * f + A[3][6] * u + A[3][7] * v + A[3][8] * z;
    y[4] = A[4][0] * p + A[4][1] * q + A[4][2] * r + A[4][3] * e + A[4][4] * f + A[4][6] * u + A[4][7] * v + A[4][8] * z;
    y[5] = A[5][0] * p + A[5][1] * q + A[5][5] * g + A[5][6] * u + A[5][7] * v + A[5][8] * z;
    y[6] = A[6][1] * q + A[6][2] * r + A[6][3] * e + A[6][4] * f + A[6][6] * u + A[6][7] * v + A[6][8] * z;
    y[7] = A[7][0] * p + A[7][2] * r + A[7][3] * e + A[7][4] * f + A[7][6] * u + A[7][7] * v + A[7][8] * z;
    y[8] = A[8][0] * p + A[8][1] * q + A[8][5] * g + A[8][6] * u + A[8][7] * v + A[8][8] * z;
}

/* What parameters add to element i of column c: B' times that column's parameter errors, which stand in P. */
static sch_real added_by_parameters(const sch_state *s, int i, int c)
{
    sch_real sum = 0;
    int k;
    if (i < 3)
        for (k = 0; k < SCH_N_ON_ATTITUDE; k++)
            sum += s->work.B[sch_on_attitude[k]][i] * s->P[9 + sch_on_attitude[k]][c];
    else
        for (k = 0; k < SCH_N_SENSOR; k++)
            sum += s->work.B[k][i] * s->P[9 + k][c];
    return sum;
}

/* Carry the covariance over the accumulated transition: P <- Phi P Phi'; noise is added by the caller. */
static void flush(sch_state *s, int decays)
{
    sch_real(*A)[9] = s->work.A, x[9], y[9];
    const sch_real *left = s->work.left, *mean = s->work.mean;
    int c, i, j, k;
    if (decays)
        for (k = 0; k < SCH_N_SENSOR; k++)
            for (i = 0; i < 9; i++)
                s->work.B[k][i] *= mean[k];
    transition(s);
    for (c = 0; c < SCH_N; c++) { /* Phi P */
        for (i = 0; i < 9; i++)
            x[i] = s->P[i][c];
        apply_navigation(A, x, y);
        for (i = 0; i < 9; i++)
            s->work.rows[i][c] = SCH_N_SENSOR > 0 ? y[i] + added_by_parameters(s, i, c) : y[i];
    }
    for (k = 9; k < SCH_N; k++) /* its parameter columns are by symmetry the parameter rows of P Phi' */
        for (i = 0; i < 9; i++)
            s->P[k][i] = s->work.rows[i][k];
    for (c = 0; c < 9; c++) { /* Phi P Phi', of which the upper half is enough */
        for (i = 0; i < 9; i++)
            x[i] = s->work.rows[c][i];
        apply_navigation(A, x, y);
        for (i = 0; i <= c; i++)
            s->work.turned[i][c] = SCH_N_SENSOR > 0 ? y[i] + added_by_parameters(s, i, c) : y[i];
    }
    for (i = 0; i < 9; i++) {
        for (j = 0; j < 9; j++)
            s->P[i][j] = j < i ? s->work.turned[j][i] : s->work.turned[i][j];
        for (j = 9; j < SCH_N; j++)
            s->P[i][j] = s->work.rows[i][j];
    }
    if (decays) {
        for (k = 9; k < SCH_N; k++)
            for (i = 0; i < 9; i++) {
                s->P[k][i] *= left[k - 9];
                s->P[i][k] *= left[k - 9];
            }
        for (i = 9; i < SCH_N; i++)
            for (j = 9; j < SCH_N; j++)
                s->P[i][j] *= left[i - 9] * left[j - 9];
    }
}

/* Half the process noise of an interval: added before and after the transition it is the trapezoid rule. */
static void add_half_noise(sch_state *s, const sch_real psd[6])
{
    const sch_real h = K(0.5) * s->acc[0];
    int i, j, k, o;
    if (psd[0] == psd[1] && psd[1] == psd[2] && psd[3] == psd[4] && psd[4] == psd[5]) {
        for (i = 0; i < 6; i++)
            s->P[i][i] += h * psd[i];
    } else {
        sch_real c[9];
        sch_dcm(s->q_eb, c);
        for (o = 0; o < 6; o += 3)
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) {
                    sch_real g = 0;
                    for (k = 0; k < 3; k++)
                        g += c[3 * i + k] * c[3 * j + k] * psd[o + k];
                    s->P[o + i][o + j] += h * g;
                }
    }
    for (k = 9; k < SCH_N; k++)
        if (s->driving[k - 9] > 0)
            s->P[k][k] += h * s->driving[k - 9];
}

/* Over T seconds what is left of each Gauss-Markov state, and its mean meanwhile; returns if any decays. */
static int decay(sch_state *s, sch_real T)
{
    int decays = 0, k;
    for (k = 0; k < SCH_N - 9; k++) {
        sch_real *mean = s->work.mean + k;
        s->work.left[k] = *mean = K(1.0);
        if (sch_decay_rate[k] > 0) {
            const sch_real x = sch_decay_rate[k] * T;
            if (x < K(0.01))
                *mean = K(1.0) - x * (K(0.5) - x * (K(1.0 / 6.0) - x * (K(1.0 / 24.0) - x / K(120.0))));
            else
                *mean = -EXPM1(-x) / x;
            s->work.left[k] = K(1.0) - x * *mean;
            decays = 1;
        }
    }
    return decays;
}

/* Carry the covariance to the present with its process noise; Gauss-Markov estimates decay. */
void sch_propagate(sch_state *s, const sch_real psd[6])
{
    int decays, i;
    if (SCH_N_SENSOR > 0)
        parameter_columns(s);
    decays = decay(s, s->acc[0]);
    add_half_noise(s, psd);
    flush(s, decays);
    if (decays) {
        for (i = 0; i < SCH_N - 9; i++)
            s->est[i] *= s->work.left[i];
        sch_spread_estimates(s->est, s->sens);
    }
    add_half_noise(s, psd);
    for (i = 0; i < 8; i++)
        s->acc[i] = 0;
    for (i = 0; i < 3; i++)
        s->moment[i] = 0;
    s->n_past = s->n_since = 0;
}
