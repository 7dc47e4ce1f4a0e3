/* Change of the covariance where updates turn axes that nothing measures, P <- J P J'.
 * The text of schuler.filtering.kernels.axes, where it is derived. */
#include "schuler_internal.h"

#if SCH_FREE_AXES

/* Columns of B: 0-2 row of N - N_before by parameter, 3 column of L; and over the first nine C - C_before, the horizontal
 * part of L, and the vertical in body axes (three). */
enum { IN_L = 3, TURN, TILT, VERTICAL };

/* Row of T in which a matrix stands: of gyroscopes, accelerometers, g-sensitivity. */
static int response(const sch_parameter *p)
{
    if (p->sensor == 1)
        return 1;
    return p->source >= 4 ? 0 : 2;
}

/* Add parameter rows of N, times a sign, to B. */
static void add_rotation(sch_state *s, sch_real sign, const sch_real *est)
{
    sch_real(*T)[9] = s->work.sums[0];
    int a, i, k;
    for (a = 0; a < 3; a++)
        for (i = 0; i < 9; i++)
            T[a][i] = i % 4 == 0 && a < 2 ? K(1.0) : K(0.0);
    for (k = 0; k < SCH_N_SENSOR; k++)
        if (sch_table[k].source > 0)
            T[response(sch_table + k)][3 * sch_table[k].axis + (sch_table[k].source - 1) % 3] += est[k];
    for (k = 0; k < SCH_N_SENSOR; k++)
        if (sch_table[k].source > 0) {
            const sch_real *t = T[response(sch_table + k)] + 3 * sch_table[k].axis;
            const int j = (sch_table[k].source - 1) % 3, p = (j + 1) % 3, q = (j + 2) % 3;
            s->work.B[k][q] += sign * t[p];
            s->work.B[k][p] -= sign * t[q];
        }
}

/* Write to B what J needs; sens are the responses before. */
static void write_change(sch_state *s)
{
    sch_real(*B)[9] = s->work.B, old[9], new_dcm[9];
    const sch_real *down = s->work.U[2];
    int a, i, j, k;
    sch_dcm(s->kept_q, old);
    sch_dcm(s->q_eb, new_dcm);
    for (k = 0; k < SCH_N_SENSOR; k++)
        for (a = 0; a < 9; a++)
            B[k][a] = 0;
    add_rotation(s, K(1.0), s->est);
    add_rotation(s, K(-1.0), s->kept_est);
    for (a = 0; a < 3; a++)
        B[a][VERTICAL] = old[a] * down[0] + old[3 + a] * down[1] + old[6 + a] * down[2];
    for (a = 0; a < 3; a++)
        for (j = 0; j < 3; j++)
            B[3 * a + j][TILT] = old[3 * j + a] - B[a][VERTICAL] * down[j];
    for (i = 0; i < 9; i++)
        B[i][TURN] = new_dcm[i] - old[i];
    for (k = 0; k < SCH_N_SENSOR; k++)
        if (sch_table[k].sensor == 1 && sch_table[k].source > 0) {
            const int r = sch_table[k].axis, p = sch_table[k].source % 3, q = (sch_table[k].source + 1) % 3;
            B[k][IN_L] = K(0.5) * (s->sens[15 + 3 * p + r] * B[q][VERTICAL] - s->sens[15 + 3 * q + r] * B[p][VERTICAL]);
        }
}

/* P <- J P */
static void add_turned(sch_state *s)
{
    sch_real(*B)[9] = s->work.B, (*R)[SCH_N] = s->work.W;
    int a, i, j, k;
    for (j = 0; j < SCH_N; j++) {
        sch_real v = 0;
        for (k = 0; k < SCH_N_SENSOR; k++)
            v += B[k][IN_L] * s->P[9 + k][j];
        for (a = 0; a < 3; a++)
            R[a][j] = B[a][VERTICAL] * v + B[3 * a][TILT] * s->P[0][j] + B[3 * a + 1][TILT] * s->P[1][j]
                      + B[3 * a + 2][TILT] * s->P[2][j];
    }
    for (j = 0; j < SCH_N; j++) {
        for (i = 0; i < 3; i++)
            s->P[i][j] += B[3 * i][TURN] * R[0][j] + B[3 * i + 1][TURN] * R[1][j] + B[3 * i + 2][TURN] * R[2][j];
        for (k = 0; k < SCH_N_SENSOR; k++)
            s->P[9 + k][j] += B[k][0] * R[0][j] + B[k][1] * R[1][j] + B[k][2] * R[2][j];
    }
}

void sch_keep_axes(sch_state *s)
{
    int i;
    if (s->corrected)
        return;
    s->corrected = 1;
    for (i = 0; i < 4; i++)
        s->kept_q[i] = s->q_eb[i];
    for (i = 0; i < SCH_N - 9; i++)
        s->kept_est[i] = s->est[i];
}

void sch_turn_axes(sch_state *s)
{
    int i, j;
    if (!s->corrected)
        return;
    s->corrected = 0;
    sch_ned_axes(s->r_eb_e, s->work.U);
    sch_spread_estimates(s->kept_est, s->sens);
    write_change(s);
    sch_spread_estimates(s->est, s->sens);
    add_turned(s);
    for (i = 0; i < SCH_N; i++)
        for (j = 0; j < i; j++) {
            const sch_real x = s->P[i][j];
            s->P[i][j] = s->P[j][i];
            s->P[j][i] = x;
        }
    add_turned(s);
    for (i = 0; i < SCH_N; i++)
        for (j = 0; j < i; j++)
            s->P[j][i] = s->P[i][j];
}

#else

void sch_keep_axes(sch_state *s)
{
    (void)s;
}

void sch_turn_axes(sch_state *s)
{
    (void)s;
}

#endif
