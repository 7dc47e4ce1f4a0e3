/* The filter sample by sample; the text of schuler.filtering.kernels.run, called as schuler.Navigator calls it. */
#include <string.h>

#include "schuler_internal.h"

static int finite_all(const sch_real *x, int n)
{
    int i;
    for (i = 0; i < n; i++)
        if (!(FABS(x[i]) <= LARGEST))
            return 0;
    return 1;
}

static int finite_wide(const double *x, int n)
{
    int i;
    for (i = 0; i < n; i++)
        if (!(fabs(x[i]) <= DBL_MAX))
            return 0;
    return 1;
}

/* C_en of a position: its columns are north, east, down in Earth-fixed axes. */
static void navigation_axes(const double r[3], sch_real C[9])
{
    sch_real U[3][3];
    int i, j;
    sch_ned_axes(r, U);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            C[3 * i + j] = U[j][i];
}

/* P <- T P T', T the matrix C on the diagonal of the three navigation blocks. */
static void turn_covariance(sch_real P[SCH_N][SCH_N], const sch_real C[9])
{
    sch_real x[3];
    int c, i, o;
    for (c = 0; c < SCH_N; c++)
        for (o = 0; o < 9; o += 3) {
            for (i = 0; i < 3; i++)
                x[i] = C[3 * i] * P[o][c] + C[3 * i + 1] * P[o + 1][c] + C[3 * i + 2] * P[o + 2][c];
            for (i = 0; i < 3; i++)
                P[o + i][c] = x[i];
        }
    for (c = 0; c < SCH_N; c++)
        for (o = 0; o < 9; o += 3) {
            for (i = 0; i < 3; i++)
                x[i] = C[3 * i] * P[c][o] + C[3 * i + 1] * P[c][o + 1] + C[3 * i + 2] * P[c][o + 2];
            for (i = 0; i < 3; i++)
                P[c][o + i] = x[i];
        }
}

int sch_init(sch_state *s, const sch_initial *initial)
{
    const sch_real *q = initial->q_eb;
    const sch_real norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    sch_real C[9];
    int i, j, k;
    if (!finite_wide(&initial->t, 1) || !finite_wide(initial->r_eb_e, 3) || !finite_all(initial->v_eb_e, 3)
        || !finite_all(q, 4) || !finite_all(initial->parameters, SCH_N - 9) || !finite_all(initial->P, SCH_LEN_PACKED)
        || FABS(norm - K(1.0)) > K(1e-3))
        return SCH_INVALID;
    for (i = 0; i < SCH_N; i++)
        if (initial->P[i * (i + 1) / 2 + i] < 0)
            return SCH_INVALID;
    memset(s, 0, sizeof *s);
    s->t = initial->t;
    for (i = 0; i < 3; i++) {
        s->r_eb_e[i] = initial->r_eb_e[i];
        s->v_eb_e[i] = initial->v_eb_e[i];
    }
    for (i = 0; i < 4; i++)
        s->q_eb[i] = q[i];
    for (i = 0; i < SCH_N - 9; i++) {
        s->est[i] = initial->parameters[i];
        s->driving[i] = sch_driving[i];
    }
    for (i = 0; i < 6; i++)
        s->psd[i] = sch_psd[i];
    for (i = 0, k = 0; i < SCH_N; i++)
        for (j = 0; j <= i; j++, k++)
            s->P[i][j] = s->P[j][i] = initial->P[k];
    navigation_axes(s->r_eb_e, C);
    turn_covariance(s->P, C);
    for (i = 0; i < SCH_N; i++)
        for (j = 0; j < i; j++)
            s->P[i][j] = s->P[j][i] = K(0.5) * (s->P[i][j] + s->P[j][i]);
    sch_start_gates(s, s->t);
    sch_spread_estimates(s->est, s->sens);
    return SCH_OK;
}

/* Correct the state by a measurement; returns what became of it. */
static int update(sch_state *s, const sch_measurement *m, sch_outcome *outcome)
{
    const sch_real *v = s->v_eb_e;
    const int slow = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] < K(SCH_MIN_SPEED) * K(SCH_MIN_SPEED);
    const int no_slip = m->kind == SCH_LATERAL || m->kind == SCH_VERTICAL;
    sch_real scale = K(1.0);
    int d, i;
    outcome->t = m->t;
    outcome->kind = m->kind;
    outcome->nis = 0;
    outcome->status = SCH_GATED;
    for (i = 0; i < 3; i++)
        outcome->innovation[i] = 0;
    if (m->gate < 0 || (slow && no_slip))
        return SCH_GATED;
    d = sch_measurement_rows(s, m);
    if (m->kind == SCH_POSITION || m->kind == SCH_VELOCITY)
        scale = s->fix[m->kind == SCH_POSITION ? 0 : 1].r_scale;
    for (i = 0; i < d; i++)
        outcome->innovation[i] = -s->work.y[i];
    for (i = 0; i < 9; i++)
        s->work.R[i] = scale * m->R[i];
    outcome->nis = sch_innovate(s, s->work.R, d);
    outcome->status = sch_judge(s, m->kind, m->t, outcome->nis, d, m->gate);
    if (outcome->status != SCH_REJECTED) {
        sch_keep_axes(s);
        sch_correct(s, d);
        sch_spread_estimates(s->est, s->sens);
    } else if (!(outcome->nis >= 0)) {
        s->failed = 1;
    }
    return outcome->status;
}

int sch_imu(sch_state *s, double t, const sch_real dtheta_ib_b[3], const sch_real dv_ib_b[3])
{
    const double h_wide = t - s->t;
    const sch_real h = K(h_wide);
    const int gap = h_wide > SCH_GAP_S;
    const sch_real *psd = s->psd;
    sch_real now[6], widened[6], d[3], s0 = 0, sa = 0;
    int i, j = 0, pausing = gap, taken = 0;
    if (s->failed)
        return SCH_FAILED;
    if (!finite_wide(&t, 1) || !finite_all(dtheta_ib_b, 3) || !finite_all(dv_ib_b, 3))
        return SCH_INVALID;
    if (!(h_wide > 0))
        return SCH_LATE;
    if (h_wide > SCH_MAX_GAP_S)
        return SCH_PAUSE;
    for (i = 0; i < 3; i++) {
        now[i] = dtheta_ib_b[i];
        now[3 + i] = dv_ib_b[i];
    }
    sch_fit_interval(s->work.raw, now, s->before, s->earlier, h, s->h1, s->h2);
    sch_compensate(s->work.poly, s->work.raw, s->sens, h);
    while (!taken) { /* s0: where in the interval the state is, sa: where its last piece began */
        const int measured = !pausing && j < s->n_pending && s->pending[j].t <= t + 1e-9;
        sch_real s1 = pausing ? K(0.0) : K(1.0);
        int wanted = pausing || measured;
        if (measured) {
            s1 = K(1.0 - (t - s->pending[j].t) / h_wide);
            if (s1 > K(1.0 - 1e-6))
                s1 = K(1.0);
        }
        if (s1 > s0) {
            const sch_real *piece = s->work.poly;
            sch_turn_axes(s);
            if (s0 > 0 || s1 < K(1.0)) {
                sch_cut_interval(s->work.part, s->work.poly, s0, s1);
                piece = s->work.part;
            }
            sch_advance(s, piece, (s1 - s0) * h, d);
            sch_store_interval(s, d, piece, (s1 - s0) * h);
            sa = s0;
            s0 = s1;
        }
        if (!wanted) {
            if (s->acc[0] > 0)
                s->n_since++;
            wanted = s->n_since >= SCH_EVERY || s->acc[1] > K(SCH_FLUSH_ANGLE) || gap;
        }
        if (wanted && s->acc[0] > 0)
            sch_propagate(s, psd);
        if (pausing) { /* before a pause was the noise that was then; over it rates are unknown by a constant */
            sch_compensate(s->work.poly, s->work.raw, s->sens, h);
            for (i = 0; i < 3; i++) {
                widened[i] = s->psd[i] + K(SCH_GAP_GYRO) * K(SCH_GAP_GYRO) * h;
                widened[3 + i] = s->psd[3 + i] + K(SCH_GAP_ACCEL) * K(SCH_GAP_ACCEL) * h;
            }
            psd = widened;
            pausing = 0;
        } else if (measured) {
            const int status = update(s, s->pending + j, s->outcomes + j);
            if (status == SCH_ACCEPTED || status == SCH_FORCED) {
                sch_compensate(s->work.poly, s->work.raw, s->sens, h);
                if (s0 > sa) { /* the next measurement of this time sees the corrected rate */
                    sch_cut_interval(s->work.part, s->work.poly, sa, s0);
                    sch_regressor_integrals(s->work.part, s->reg);
                }
            }
            j++;
        } else {
            taken = 1;
        }
    }
    s->n_outcomes = j;
    s->n_pending -= j;
    memmove(s->pending, s->pending + j, (size_t)s->n_pending * sizeof *s->pending);
    for (i = 0; i < 6; i++) {
        s->earlier[i] = s->before[i];
        s->before[i] = now[i];
    }
    s->h2 = s->h1;
    s->h1 = h;
    s->t = t;
    return s->failed ? SCH_FAILED : SCH_OK;
}

/* Let a measurement wait for its sample, behind those of the same time. */
static int announce(sch_state *s, const sch_measurement *m)
{
    int i;
    if (!finite_wide(&m->t, 1) || !finite_wide(m->z, 3) || !finite_all(m->R, 9))
        return SCH_INVALID;
    if (m->t <= s->t)
        return SCH_LATE;
    if (s->n_pending == SCH_PENDING)
        return SCH_FULL;
    for (i = s->n_pending; i > 0 && s->pending[i - 1].t > m->t; i--)
        s->pending[i] = s->pending[i - 1];
    s->pending[i] = *m;
    s->n_pending++;
    return SCH_OK;
}

static sch_measurement measurement(int kind, double t, sch_real gate, const sch_real lever[3])
{
    sch_measurement m;
    memset(&m, 0, sizeof m);
    m.kind = kind;
    m.t = t;
    m.gate = gate;
    memcpy(m.lever, lever, sizeof m.lever);
    return m;
}

/* A measurement of three components with a covariance. */
static int announce_vector(sch_state *s, sch_measurement *m, const sch_real R[9])
{
    if (!(R[0] > 0) || !(R[4] > 0) || !(R[8] > 0))
        return SCH_INVALID;
    memcpy(m->R, R, sizeof m->R);
    return announce(s, m);
}

int sch_position(sch_state *s, double t, const double r_ea_e[3], const sch_real covariance_n[9])
{
    static const sch_real lever[3] = SCH_LEVER_ANTENNA;
    sch_measurement m = measurement(SCH_POSITION, t, K(SCH_GATE_FIX), lever);
    if (!SCH_HAS_POSITION)
        return SCH_ABSENT;
    memcpy(m.z, r_ea_e, sizeof m.z);
    return announce_vector(s, &m, covariance_n);
}

int sch_velocity(sch_state *s, double t, const sch_real v_ea_n[3], const sch_real covariance_n[9])
{
    static const sch_real lever[3] = SCH_LEVER_ANTENNA;
    sch_measurement m = measurement(SCH_VELOCITY, t, K(SCH_GATE_FIX), lever);
    int i;
    if (!SCH_HAS_VELOCITY)
        return SCH_ABSENT;
    for (i = 0; i < 3; i++)
        m.z[i] = (double)v_ea_n[i];
    return announce_vector(s, &m, covariance_n);
}

int sch_zupt(sch_state *s, double t, sch_real sigma)
{
    static const sch_real lever[3] = {0};
    sch_measurement m = measurement(SCH_ZERO_VELOCITY, t, K(SCH_GATE_ZUPT), lever);
    const sch_real variance = sigma * sigma, R[9] = {variance, 0, 0, 0, variance, 0, 0, 0, variance};
    if (!SCH_HAS_ZUPT)
        return SCH_ABSENT;
    return announce_vector(s, &m, R);
}

int sch_non_holonomic(sch_state *s, double t, int lateral, int vertical)
{
    static const sch_real lever[3] = SCH_LEVER_AXLE;
    sch_measurement m = measurement(SCH_LATERAL, t, lateral ? K(SCH_GATE_NON_HOLONOMIC) : K(-1.0), lever);
    int status;
    if (!SCH_HAS_NON_HOLONOMIC)
        return SCH_ABSENT;
    if (s->n_pending + 2 > SCH_PENDING)
        return SCH_FULL;
    m.R[0] = K(SCH_SIGMA_LATERAL) * K(SCH_SIGMA_LATERAL);
    status = announce(s, &m);
    if (status != SCH_OK)
        return status;
    m.kind = SCH_VERTICAL;
    m.gate = vertical ? K(SCH_GATE_NON_HOLONOMIC) : K(-1.0);
    m.R[0] = K(SCH_SIGMA_VERTICAL) * K(SCH_SIGMA_VERTICAL);
    return announce(s, &m);
}

int sch_odometer(sch_state *s, double t, sch_real speed, sch_real sigma)
{
    static const sch_real lever[3] = SCH_LEVER_WHEEL;
    sch_measurement m = measurement(SCH_SPEED, t, K(SCH_GATE_ODOMETER), lever);
    if (!SCH_HAS_ODOMETER)
        return SCH_ABSENT;
    if (!(sigma > 0))
        return SCH_INVALID;
    m.z[0] = (double)speed;
    m.R[0] = sigma * sigma;
    return announce(s, &m);
}

void sch_ecef_from_llh(const double llh[3], double r[3])
{
    const double sL = sin(llh[0]), cL = cos(llh[0]), R = EARTH_A / sqrt(1.0 - EARTH_E2 * sL * sL);
    r[0] = (R + llh[2]) * cL * cos(llh[1]);
    r[1] = (R + llh[2]) * cL * sin(llh[1]);
    r[2] = ((1.0 - EARTH_E2) * R + llh[2]) * sL;
}

void sch_llh_from_ecef(const double r[3], double llh[3])
{
    const double p = sqrt(r[0] * r[0] + r[1] * r[1]);
    double S = EARTH_A * r[2], C = EARTH_B * p, norm;
    int k;
    for (k = 0; k < 2; k++) { /* two of Bowring's steps on the reduced latitude: rounding */
        norm = sqrt(S * S + C * C);
        S /= norm;
        C /= norm;
        S = (1.0 - EARTH_F) * (r[2] + EARTH_E2 / (1.0 - EARTH_E2) * EARTH_B * S * S * S);
        C = p - EARTH_E2 * EARTH_A * C * C * C;
    }
    S /= 1.0 - EARTH_F;
    norm = sqrt(S * S + C * C);
    S /= norm;
    C /= norm;
    llh[0] = atan2(S, C);
    llh[1] = atan2(r[1], r[0]);
    llh[2] = p * C + r[2] * S - EARTH_A * sqrt(1.0 - EARTH_E2 * S * S);
}

/* Quaternion of a direction cosine matrix. */
static void quaternion(const sch_real c[9], sch_real q[4])
{
    const sch_real trace = c[0] + c[4] + c[8];
    const int largest = c[0] > c[4] ? (c[0] > c[8] ? 0 : 2) : (c[4] > c[8] ? 1 : 2);
    const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > c[4 * i]) {
        const sch_real w = K(2.0) * SQRT(K(1.0) + trace);
        q[0] = K(0.25) * w;
        q[1] = (c[7] - c[5]) / w;
        q[2] = (c[2] - c[6]) / w;
        q[3] = (c[3] - c[1]) / w;
    } else {
        const sch_real w = K(2.0) * SQRT(K(1.0) + c[4 * i] - c[4 * j] - c[4 * k]);
        q[0] = (c[3 * k + j] - c[3 * j + k]) / w;
        q[1 + i] = K(0.25) * w;
        q[1 + j] = (c[3 * i + j] + c[3 * j + i]) / w;
        q[1 + k] = (c[3 * i + k] + c[3 * k + i]) / w;
    }
}

static void product3(const sch_real a[9], const sch_real b[9], int transpose_a, sch_real out[9])
{
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            out[3 * i + j] = 0;
            for (k = 0; k < 3; k++)
                out[3 * i + j] += (transpose_a ? a[3 * k + i] : a[3 * i + k]) * b[3 * k + j];
        }
}

void sch_solve(const sch_state *s, sch_solution *solution)
{
    sch_real C[9], c[9], out[9];
    int i, j, k, o;
    navigation_axes(s->r_eb_e, C);
    solution->t = s->t;
    sch_llh_from_ecef(s->r_eb_e, solution->llh);
    for (i = 0; i < 3; i++)
        solution->v_eb_n[i] = C[i] * s->v_eb_e[0] + C[3 + i] * s->v_eb_e[1] + C[6 + i] * s->v_eb_e[2];
    sch_dcm(s->q_eb, c);
    product3(C, c, 1, out);
    quaternion(out, solution->q_nb);
    for (o = 0; o < 9; o += 3)
        for (i = 0; i < 3; i++) {
            sch_real variance = 0;
            for (j = 0; j < 3; j++)
                for (k = 0; k < 3; k++)
                    variance += C[3 * j + i] * s->P[o + j][o + k] * C[3 * k + i];
            solution->sigma[o + i] = SQRT(variance > 0 ? variance : K(0.0));
        }
}

void sch_initial_from_sigmas(sch_initial *initial, double t, const double llh[3], const sch_real v_eb_n[3],
                             const sch_real q_nb[4], const sch_real attitude[3], const sch_real velocity[3],
                             const sch_real position[3])
{
    sch_real C[9], c[9], out[9];
    int i;
    memset(initial, 0, sizeof *initial);
    initial->t = t;
    sch_ecef_from_llh(llh, initial->r_eb_e);
    navigation_axes(initial->r_eb_e, C);
    for (i = 0; i < 3; i++)
        initial->v_eb_e[i] = C[3 * i] * v_eb_n[0] + C[3 * i + 1] * v_eb_n[1] + C[3 * i + 2] * v_eb_n[2];
    sch_dcm(q_nb, c);
    product3(C, c, 0, out);
    quaternion(out, initial->q_eb);
    for (i = 0; i < SCH_N; i++) {
        const sch_real sigma = i < 3 ? attitude[i] : i < 6 ? velocity[i - 3] : i < 9 ? position[i - 6] : K(0.0);
        initial->P[i * (i + 1) / 2 + i] = i < 9 ? sigma * sigma : sch_initial_variance[i - 9];
    }
}
