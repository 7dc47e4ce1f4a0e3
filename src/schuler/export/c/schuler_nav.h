/* Error-state filter around an Earth-fixed strapdown, for one configuration (schuler_config.h).
 *
 * The filter of `schuler navigate`, sample by sample: loosely coupled positions and velocities, zero velocity, wheels that do
 * not slip, odometer. No allocation, no variables outside sch_state; any number of filters, each in its own sch_state.
 *
 * SI units and radians. Body axes forward, right, down; navigation axes north, east, down (n); Earth-fixed axes (e).
 * Quaternions have the scalar first and turn body into the named axes. Covariances are row by row.
 *
 * Order of calls: sch_init; then for every IMU sample first the measurements that fall into its interval, each at its own
 * time, in any order, then sch_imu. A measurement that is announced too late is refused (SCH_LATE), never used at a wrong
 * time: give samples to the filter as long after they were taken as receivers report late.
 *
 * With SCH_FLOAT defined sch_real is single precision; time and position stay double, since an Earth-fixed metre needs them.
 */
#ifndef SCHULER_NAV_H
#define SCHULER_NAV_H

#include "schuler_config.h"

#ifdef SCH_FLOAT
typedef float sch_real;
#else
typedef double sch_real;
#endif

/* Lengths of arrays, at least 1: C99 has none of length zero. */
#define SCH_LEN_PARAMETERS (SCH_N > 9 ? SCH_N - 9 : 1)
#define SCH_LEN_SENSOR (SCH_N_SENSOR > 0 ? SCH_N_SENSOR : 1)
#define SCH_LEN_PACKED (SCH_N * (SCH_N + 1) / 2)
#define SCH_N_PAST 38

/* What a call returns; below zero nothing was taken. */
enum {
    SCH_OK = 0,
    SCH_INVALID = -1, /* a number is not finite, or a variance not positive */
    SCH_LATE = -2,    /* time does not advance; a measurement is not after the filter's time */
    SCH_PAUSE = -3,   /* a sample later than SCH_MAX_GAP_S: align again and call sch_init */
    SCH_FULL = -4,    /* SCH_PENDING measurements wait already */
    SCH_FAILED = -5,  /* an innovation has no positive variance: align again and call sch_init */
    SCH_ABSENT = -6   /* an aid that the configuration does not have */
};

enum { SCH_POSITION = 1, SCH_VELOCITY, SCH_ZERO_VELOCITY, SCH_LATERAL, SCH_VERTICAL, SCH_SPEED, SCH_N_KINDS };

/* What became of a measurement. */
enum {
    SCH_ACCEPTED = 1,
    SCH_REJECTED,
    SCH_FORCED, /* beyond the gate, taken with a covariance enlarged for it */
    SCH_GATED   /* its condition is not met */
};

typedef struct {
    double t; /* [s] */
    int kind, status;
    sch_real nis;           /* normalised innovation squared */
    sch_real innovation[3]; /* measured minus predicted */
} sch_outcome;

/* Where the filter starts. */
typedef struct {
    double t;
    double r_eb_e[3];                        /* [m] */
    sch_real v_eb_e[3];                      /* [m/s] */
    sch_real q_eb[4];
    sch_real parameters[SCH_LEN_PARAMETERS]; /* estimates behind the nine navigation states */
    sch_real P[SCH_LEN_PACKED];              /* lower triangle row by row; navigation errors in n: attitude, velocity, position */
} sch_initial;

/* The filter's estimate, as a user reads it. */
typedef struct {
    double t;
    double llh[3];     /* latitude, longitude [rad], ellipsoidal height [m] */
    sch_real v_eb_n[3];
    sch_real q_nb[4];
    sch_real sigma[9]; /* 1-sigma of attitude [rad], velocity [m/s], position [m], each n e d; at the last propagation */
} sch_solution;

/* A measurement that waits. */
typedef struct {
    double t;
    double z[3];
    sch_real R[9], lever[3], gate;
    int kind;
} sch_measurement;

/* Memory of the innovation test for positions or velocities. */
typedef struct {
    double used_at, first_at, last_at;
    sch_real count, drifted, first_nis, steps, step_nis, step_product, mean_nis, lagged, after_update, r_scale, sigma;
    sch_real first[3], last[3], step[3], white[3];
} sch_fix_memory;

/* Everything a filter is. Read t, r_eb_e, v_eb_e, q_eb, est, P, outcomes; write nothing. */
typedef struct {
    double t, r_eb_e[3];
    sch_real v_eb_e[3], q_eb[4];
    sch_real est[SCH_LEN_PARAMETERS];
    sch_real P[SCH_N][SCH_N]; /* errors (estimate minus truth) in e, at the last propagation */
    int n_outcomes;           /* of the last sch_imu */
    sch_outcome outcomes[SCH_PENDING];

    int n_pending, failed;
    sch_measurement pending[SCH_PENDING];
    sch_real sens[33]; /* estimated sensor errors: b_g, b_a, inverse of I + M_g, of I + M_a, G_g */
    sch_real acc[8];   /* since the last propagation: time, turned angle, sums of velocity increments */
    sch_real moment[3];
    sch_real past[SCH_EVERY + 2][SCH_N_PAST]; /* intervals since the last propagation */
    int n_past, n_since;
    sch_real before[6], earlier[6], h1, h2;   /* the two increments before this */
    int corrected;                            /* since the last sample; attitude and parameters before that: */
    sch_real kept_q[4], kept_est[SCH_LEN_PARAMETERS];
    sch_real reg[7];                          /* integrals of time, force and rate over the present interval */
    sch_fix_memory fix[2];                    /* position, velocity */
    int rejections[SCH_N_KINDS];
    double readmitted_at;
    sch_real noise_scale;
    sch_real psd[6];
    sch_real driving[SCH_LEN_PARAMETERS];
    struct { /* memory that is written before it is read, here so that no stack has to hold it */
        sch_real raw[18], poly[18], part[18];
        sch_real B[SCH_LEN_SENSOR][9], A[9][9], rows[9][SCH_N], turned[9][9];
        sch_real left[SCH_LEN_PARAMETERS], mean[SCH_LEN_PARAMETERS], sums[4][7][9];
        sch_real H[3][SCH_N], W[3][SCH_N], y[3], e[3], S[3][3], U[3][3], R[9];
    } work;
} sch_state;

#ifdef __cplusplus
extern "C" {
#endif

/* Start with 1-sigma values north, east, down and the configuration's uncertainty of the parameters (estimates zero). */
void sch_initial_from_sigmas(sch_initial *initial, double t, const double llh[3], const sch_real v_eb_n[3],
                             const sch_real q_nb[4], const sch_real attitude[3], const sch_real velocity[3],
                             const sch_real position[3]);
int sch_init(sch_state *s, const sch_initial *initial);

/* One IMU sample: integrals of rate [rad] and specific force [m/s] from the previous sample to t. */
int sch_imu(sch_state *s, double t, const sch_real dtheta_ib_b[3], const sch_real dv_ib_b[3]);

/* Position of the antenna, and the covariance of its error in n. sch_ecef_from_llh makes one of latitude and longitude. */
int sch_position(sch_state *s, double t, const double r_ea_e[3], const sch_real covariance_n[9]);
/* Velocity of the antenna over ground in n. */
int sch_velocity(sch_state *s, double t, const sch_real v_ea_n[3], const sch_real covariance_n[9]);
/* The vehicle rests; 1-sigma of what may still move [m/s], SCH_ZUPT_SIGMA as configured. */
int sch_zupt(sch_state *s, double t, sch_real sigma);
/* No velocity across and up at the axle. Pass 0 where a condition is not met: a sharp turn, hard braking; it is counted then
 * and not used. Below SCH_MIN_SPEED the filter leaves both out by itself. */
int sch_non_holonomic(sch_state *s, double t, int lateral, int vertical);
/* Forward speed of a wheel. */
int sch_odometer(sch_state *s, double t, sch_real speed, sch_real sigma);

void sch_solve(const sch_state *s, sch_solution *solution);
void sch_ecef_from_llh(const double llh[3], double r_e[3]);
void sch_llh_from_ecef(const double r_e[3], double llh[3]);

#ifdef __cplusplus
}
#endif

#endif
