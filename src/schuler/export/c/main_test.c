/* Replays vector.csv through the filter and compares with the numbers that schuler wrote into it.
 *
 *   main_test vector.csv [difference in sigmas [trace.csv]]
 *
 * Of a position four nanometres are taken off first, the rounding of its coordinates. In double the largest difference
 * counts, and no measurement may be judged differently. In single precision a measurement at the edge of its gate may fall
 * on the other side, and states part for a while: the root mean square counts there, and one decision in a thousand.
 *
 * The trace is time and difference of every state that is compared.
 *
 * Lines: "initial" (start), "position", "velocity", "zupt", "non_holonomic", "odometer", "imu" (inputs), "outcome" (what
 * became of a measurement of the sample before), "expected" (state and 1-sigma values after the sample before). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "schuler_nav.h"

#define MOST (64 + SCH_LEN_PARAMETERS + SCH_LEN_PACKED + 64 * 12)

static double number[MOST];
static sch_real real[MOST];

/* Numbers of a line behind its tag; how many. */
static int numbers(char *text)
{
    int n = 0;
    char *end;
    while (*text == ',' && n < MOST) {
        number[n] = strtod(text + 1, &end);
        real[n] = (sch_real)number[n];
        n++;
        text = end;
    }
    return n;
}

static double largest(double a, double b)
{
    return b > a || b != b ? b : a;
}

/* Four units in the last place of an Earth-fixed coordinate in double: what rounding of samples leaves of a position [m]. */
#define RESOLUTION 4e-9

/* Largest difference from an "expected" line in sigmas of the state; of sigmas in parts of themselves, to *of_sigmas. */
static double difference(const sch_state *s, double *of_sigmas, double *squares)
{
    const double *r = number + 1, *v = r + 3, *q = v + 3, *est = q + 4, *sigma = est + SCH_N - 9;
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    double e[9], n[9], most = 0;
    sch_solution solution;
    double turn[3];
    double sL, cL, sl, cl;
    int i;
    sch_solve(s, &solution);
    sL = sin(solution.llh[0]), cL = cos(solution.llh[0]), sl = sin(solution.llh[1]), cl = cos(solution.llh[1]);
    /* rotation from the expected attitude to the filter's, twice the vector part of q times the conjugate */
    turn[0] = -(double)s->q_eb[0] * x + (double)s->q_eb[1] * w - (double)s->q_eb[2] * z + (double)s->q_eb[3] * y;
    turn[1] = -(double)s->q_eb[0] * y + (double)s->q_eb[1] * z + (double)s->q_eb[2] * w - (double)s->q_eb[3] * x;
    turn[2] = -(double)s->q_eb[0] * z - (double)s->q_eb[1] * y + (double)s->q_eb[2] * x + (double)s->q_eb[3] * w;
    for (i = 0; i < 3; i++) {
        e[i] = 2.0 * turn[i];
        e[3 + i] = (double)s->v_eb_e[i] - v[i];
        e[6 + i] = s->r_eb_e[i] - r[i];
    }
    for (i = 0; i < 9; i += 3) { /* to north, east, down, as the sigmas */
        n[i] = -sL * cl * e[i] - sL * sl * e[i + 1] + cL * e[i + 2];
        n[i + 1] = -sl * e[i] + cl * e[i + 1];
        n[i + 2] = -cL * cl * e[i] - cL * sl * e[i + 1] - sL * e[i + 2];
    }
    for (i = 0; i < SCH_N; i++) {
        const double is = i < 9 ? n[i] : (double)s->est[i - 9] - est[i - 9];
        const double own = i < 9 ? (double)solution.sigma[i] : sqrt((double)s->P[i][i]);
        const double beyond = i < 6 || i > 8 ? fabs(is) : fabs(is) > RESOLUTION ? fabs(is) - RESOLUTION : 0.0;
        most = largest(most, is != is ? is : beyond / sigma[i]);
        *squares += beyond * beyond / (sigma[i] * sigma[i]) / SCH_N;
        *of_sigmas = largest(*of_sigmas, fabs(own / sigma[i] - 1.0));
    }
    return most;
}

int main(int argc, char **argv)
{
    static sch_state s;
    static sch_initial initial;
    static char line[32 * MOST];
    const double limit = argc > 2 ? strtod(argv[2], NULL) : 1e-9;
    double most = 0, squares = 0, of_sigmas = 0, of_nis = 0, start = 0, root;
    long samples = 0, outcomes = 0, other = 0, compared = 0, row = 0;
    int next = 0;
    FILE *file = argc > 1 ? fopen(argv[1], "r") : NULL, *trace = argc > 3 ? fopen(argv[3], "w") : NULL;
    if (file == NULL) {
        fprintf(stderr, "main_test: expected the name of a vector.csv that can be read\n");
        return 2;
    }
    while (fgets(line, sizeof line, file)) {
        char *comma = strchr(line, ',');
        int n, status = SCH_OK, i, wanted = -1;
        row++;
        if (line[0] == '#')
            continue;
        n = comma ? numbers(comma) : 0;
        if (comma)
            *comma = 0;
        if (strcmp(line, "initial") == 0) {
            wanted = 11 + SCH_N - 9 + SCH_LEN_PACKED;
            if (n == wanted) {
                start = initial.t = number[0];
                for (i = 0; i < 3; i++)
                    initial.r_eb_e[i] = number[1 + i], initial.v_eb_e[i] = real[4 + i];
                memcpy(initial.q_eb, real + 7, sizeof initial.q_eb);
                for (i = 0; i < SCH_N - 9; i++)
                    initial.parameters[i] = real[11 + i];
                memcpy(initial.P, real + 11 + SCH_N - 9, sizeof initial.P);
                status = sch_init(&s, &initial);
            }
        } else if (strcmp(line, "imu") == 0) {
            wanted = 7;
            if (n == wanted)
                status = sch_imu(&s, number[0], real + 1, real + 4);
            samples++;
            next = 0;
        } else if (strcmp(line, "position") == 0) {
            wanted = 13;
            if (n == wanted)
                status = sch_position(&s, number[0], number + 1, real + 4);
        } else if (strcmp(line, "velocity") == 0) {
            wanted = 13;
            if (n == wanted)
                status = sch_velocity(&s, number[0], real + 1, real + 4);
        } else if (strcmp(line, "zupt") == 0) {
            wanted = 2;
            if (n == wanted)
                status = sch_zupt(&s, number[0], real[1]);
        } else if (strcmp(line, "non_holonomic") == 0) {
            wanted = 3;
            if (n == wanted)
                status = sch_non_holonomic(&s, number[0], number[1] != 0, number[2] != 0);
        } else if (strcmp(line, "odometer") == 0) {
            wanted = 3;
            if (n == wanted)
                status = sch_odometer(&s, number[0], real[1], real[2]);
        } else if (strcmp(line, "outcome") == 0) {
            wanted = 4;
            if (n == wanted && next < s.n_outcomes) {
                const sch_outcome *o = s.outcomes + next++;
                const double nis = o->status == SCH_GATED ? 0.0 : fabs((double)o->nis - number[3]) / (1.0 + number[3]);
                other += o->t != number[0] || o->kind != (int)number[1] || o->status != (int)number[2];
                of_nis = largest(of_nis, nis);
            } else {
                other++;
            }
            outcomes++;
        } else if (strcmp(line, "expected") == 0) {
            wanted = 11 + SCH_N - 9 + SCH_N;
            if (n == wanted) {
                const double is = difference(&s, &of_sigmas, &squares);
                most = largest(most, is);
                if (trace)
                    fprintf(trace, "%.3f,%.3g\n", s.t - start, is);
            }
            compared++;
        }
        if (n != wanted || status != SCH_OK) {
            fprintf(stderr, "line %ld, %s: %d numbers of %d, the filter returned %d\n", row, line, n, wanted, status);
            return 2;
        }
    }
    fclose(file);
    if (trace)
        fclose(trace);
    root = sqrt(squares / (compared > 0 ? compared : 1));
    printf("%ld samples, %.1f s; %ld measurements, %ld judged differently; %ld states compared\n", samples, s.t - start,
           outcomes, other, compared);
    printf("largest difference: states %.3g sigma (root mean square %.3g), sigmas %.3g of themselves, innovations %.3g\n",
           most, root, of_sigmas, of_nis);
    if (sizeof(sch_real) == sizeof(double))
        root = largest(most, of_sigmas);
    else
        other = other > outcomes / 1000;
    if (!(root <= limit) || other || compared == 0) {
        printf("FAILED: expected at most %g\n", limit);
        return 1;
    }
    printf("ok: at most %g\n", limit);
    return 0;
}
