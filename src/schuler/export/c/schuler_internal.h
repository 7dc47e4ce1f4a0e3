/* What the files of the filter share. */
#ifndef SCHULER_INTERNAL_H
#define SCHULER_INTERNAL_H

#include <float.h>
#include <math.h>

#include "schuler_nav.h"

/* A number in the precision of the filter: an unmarked 0.5 would make a product of two floats double. */
#define K(x) ((sch_real)(x))

#ifdef SCH_FLOAT
#define SQRT sqrtf
#define SIN sinf
#define COS cosf
#define EXPM1 expm1f
#define FABS fabsf
#define LARGEST FLT_MAX
#define EQUAL_STEPS 1e-5f /* relative difference of sample intervals that is rounding of their stamps */
#else
#define SQRT sqrt
#define SIN sin
#define COS cos
#define EXPM1 expm1
#define FABS fabs
#define LARGEST DBL_MAX
#define EQUAL_STEPS 1e-9
#endif

#define EARTH_A 6378137.0
#define EARTH_B 6356752.314245179
#define EARTH_F 0.0033528106647474805
#define EARTH_E2 0.0066943799901413165
#define EARTH_GM 3.986004418e14
#define EARTH_RATE 7.292115e-5 /* of gravity; SCH_OMEGA_IE turns the axes */

/* A sensor parameter: 0 gyroscope or 1 accelerometer, its axis, and what it multiplies: 0 time, 1-3 force, 4-6 rate. */
typedef struct {
    unsigned char sensor, axis, source;
} sch_parameter;

extern const sch_parameter sch_table[SCH_LEN_SENSOR];
extern const int sch_on_attitude[SCH_LEN_SENSOR]; /* parameters that act on the attitude */
extern const sch_real sch_decay_rate[SCH_LEN_PARAMETERS];
extern const sch_real sch_driving[SCH_LEN_PARAMETERS];
extern const sch_real sch_initial_variance[SCH_LEN_PARAMETERS];
extern const sch_real sch_psd[6];

/* mechanization.c */
void sch_gravity(const double r[3], sch_real g[3]);
void sch_fit_interval(sch_real poly[18], const sch_real now[6], const sch_real before[6], const sch_real earlier[6],
                      sch_real h, sch_real h1, sch_real h2);
void sch_cut_interval(sch_real part[18], const sch_real poly[18], sch_real s0, sch_real s1);
void sch_rotate_by(sch_real q[4], sch_real x, sch_real y, sch_real z);
void sch_advance(sch_state *s, const sch_real poly[18], sch_real h, sch_real d[3]);
void sch_dcm(const sch_real q[4], sch_real c[9]);

/* covariance.c */
void sch_regressor_integrals(const sch_real poly[18], sch_real reg[7]);
void sch_store_interval(sch_state *s, const sch_real d[3], const sch_real poly[18], sch_real h);
void sch_spread_estimates(const sch_real *est, sch_real sens[33]);
void sch_compensate(sch_real poly[18], const sch_real raw[18], const sch_real sens[33], sch_real h);
void sch_propagate(sch_state *s, const sch_real psd[6]);

/* axes.c */
void sch_keep_axes(sch_state *s);
void sch_turn_axes(sch_state *s);

/* update.c */
void sch_ned_axes(const double r[3], sch_real U[3][3]);
int sch_measurement_rows(sch_state *s, const sch_measurement *m);
sch_real sch_innovate(sch_state *s, const sch_real R[9], int d);
void sch_correct(sch_state *s, int d);

/* gate.c */
void sch_start_gates(sch_state *s, double t);
int sch_judge(sch_state *s, int kind, double t, sch_real nis, int d, sch_real gate);

#endif
