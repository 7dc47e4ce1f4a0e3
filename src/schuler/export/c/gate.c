/* Innovation test: which fix is wrong, and when it is the filter that is; the text of schuler.filtering.kernels.gate, whose
 * docstring says what the rules are and why. */
#include "schuler_internal.h"

#define DRIFT K(400.0)
#define PAUSE_S 3.0
#define ROUGH K(4.0)
#define GROWN K(2.5)
#define SLIGHT K(2.0)
#define TRUST 2.0
#define EXCLUDES K(4.0)
#define FORGET K(0.05)
#define TOO_LARGE K(2.0)
#define SMALL K(0.9)
#define ALTERNATING K(-0.1)
#define GROWTH K(4.0)
#define MOST_GROWTH K(16.0)
#define SHRINK K(0.98)
#define MOST_NOISE K(1e3)
#define MOST_R K(1e6)

/* Memory of positions or velocities. */
static sch_fix_memory *memory_of(sch_state *s, int kind)
{
    return s->fix + (kind == SCH_POSITION ? 0 : 1);
}

static sch_real within(sch_real x, sch_real low, sch_real high)
{
    return x < low ? low : x > high ? high : x;
}

/* Product of two innovations, each component by its variance in a fix. */
static sch_real dot(const sch_real a[3], const sch_real b[3], const sch_real R[9])
{
    return a[0] * b[0] / R[0] + a[1] * b[1] / R[4] + a[2] * b[2] / R[8];
}

/* Memory of a filter that starts at t: nothing seen, noise as stated. */
void sch_start_gates(sch_state *s, double t)
{
    static const sch_fix_memory nothing;
    int i;
    for (i = 0; i < 2; i++) {
        s->fix[i] = nothing;
        s->fix[i].used_at = s->fix[i].first_at = s->fix[i].last_at = -HUGE_VAL;
        s->fix[i].mean_nis = s->fix[i].r_scale = K(1.0);
        s->fix[i].sigma = K(HUGE_VAL);
    }
    for (i = 0; i < SCH_N_KINDS; i++)
        s->rejections[i] = 0;
    s->noise_scale = K(1.0);
    s->readmitted_at = t;
}

/* Multiply the variance of the IMU's noise, within 1 and MOST_NOISE; the states of others keep theirs. */
static void scale_noise(sch_state *s, sch_real factor)
{
    int i;
    s->noise_scale = within(s->noise_scale * factor, K(1.0), MOST_NOISE);
    for (i = 0; i < 6; i++)
        s->psd[i] = s->noise_scale * sch_psd[i];
    for (i = 0; i < SCH_N_SENSOR; i++)
        s->driving[i] = s->noise_scale * sch_driving[i];
}

/* Multiply the variance of the fixes of a kind, within 1 and MOST_R. */
static void scale_fixes(sch_fix_memory *row, sch_real factor)
{
    row->r_scale = within(row->r_scale * factor, K(1.0), MOST_R);
}

/* Enlarge the noise that innovations show to be too small: the fixes' where they alternate, or the IMU's. */
static void grow_noise(sch_state *s, sch_fix_memory *row, sch_real factor)
{
    if (row->lagged < ALTERNATING * row->mean_nis || s->noise_scale >= MOST_NOISE)
        scale_fixes(row, GROWTH);
    else
        scale_noise(s, within(factor, GROWTH, MOST_GROWTH));
}

/* Take an innovation into the forgotten means, and let the noise follow them; `shrunk` is a factor on e. */
static void follow(sch_state *s, sch_fix_memory *row, sch_real nis, sch_real shrunk)
{
    sch_real product = 0;
    int i;
    for (i = 0; i < 3; i++) {
        product += shrunk * s->work.e[i] * row->white[i];
        row->white[i] = shrunk * s->work.e[i];
    }
    if (row->after_update > 0)
        row->lagged += FORGET * (product / K(3.0) - row->lagged);
    row->mean_nis += FORGET * (nis / K(3.0) - row->mean_nis);
    if (row->mean_nis > TOO_LARGE) {
        grow_noise(s, row, GROWTH);
        row->mean_nis = K(1.0);
        row->lagged = 0;
    } else if (row->mean_nis < SMALL) {
        if (row->r_scale > K(1.0))
            scale_fixes(row, SHRINK);
        if (s->noise_scale > K(1.0))
            scale_noise(s, SHRINK);
    }
}

/* Covariance of navigation states and IMU errors times a factor: a drift of unknown origin. */
static void enlarge_in_proportion(sch_state *s, sch_real factor)
{
    int i, j;
    for (i = 0; i < 9 + SCH_N_SENSOR; i++)
        for (j = 0; j < 9 + SCH_N_SENSOR; j++)
            s->P[i][j] *= factor;
}

/* Covariance of position or velocity larger by an innovation squared, horizontal and vertical: a jump. With a position,
 * velocity grows by the square of `velocity`. */
static void enlarge_alone(sch_state *s, int kind, sch_real velocity)
{
    const sch_real *y = s->work.y, h = y[0] * y[0] + y[1] * y[1], v = y[2] * y[2];
    sch_real(*U)[3] = s->work.U;
    const int first = kind == SCH_POSITION ? 6 : 3;
    int i, j;
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++)
            s->P[first + i][first + j] += h * (U[0][i] * U[0][j] + U[1][i] * U[1][j]) + v * U[2][i] * U[2][j];
        if (kind == SCH_POSITION)
            s->P[3 + i][3 + i] += velocity * velocity;
    }
}

/* Memory after a fix that was used. */
static void taken(sch_state *s, sch_fix_memory *row, double t)
{
    int i;
    row->count = 0;
    row->used_at = t;
    row->after_update = K(1.0);
    for (i = 0; i < 3; i++)
        row->white[i] = s->work.e[i];
}

/* Take a fix that a drift of the filter over `coast` seconds keeps beyond the gate. */
static int readmit(sch_state *s, int kind, double t, sch_real nis, sch_real gate, double coast)
{
    const sch_real *y = s->work.y;
    enlarge_in_proportion(s, within(nis / K(3.0), K(1.0), DRIFT));
    if (sch_innovate(s, s->work.R, 3) > gate) {
        enlarge_alone(s, kind, K(2.0) * SQRT(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / K(coast));
        sch_innovate(s, s->work.R, 3);
    }
    s->readmitted_at = t;
    taken(s, memory_of(s, kind), t);
    return SCH_FORCED;
}

/* Take a fix from which the filter is away by a jump. */
static int jump(sch_state *s, int kind, double t, sch_real velocity)
{
    enlarge_alone(s, kind, velocity);
    sch_innovate(s, s->work.R, 3);
    s->readmitted_at = t;
    taken(s, memory_of(s, kind), t);
    return SCH_FORCED;
}

/* Memory of a fix beyond the gate: how innovations have moved since the first. */
static void remember(sch_state *s, int kind, double t, sch_real nis, sch_real gate)
{
    const sch_real *y = s->work.y, *R = s->work.R;
    sch_fix_memory *row = memory_of(s, kind), *other = s->fix + (kind == SCH_POSITION ? 1 : 0);
    int i;
    if (row->count == 0) {
        const double later = row->used_at > other->used_at ? row->used_at : other->used_at;
        const double used = other->used_at == t ? row->used_at : later;
        sch_real inside = 0;
        for (i = 0; i < 3; i++) {
            row->first[i] = y[i];
            row->step[i] = 0;
            inside += y[i] * y[i] / (R[4 * i] + DRIFT * (s->work.S[i][i] - R[4 * i]));
        }
        row->drifted = t - used >= PAUSE_S && inside <= gate ? K(1.0) : K(0.0);
        row->first_at = t;
        row->first_nis = nis;
        row->steps = row->step_nis = row->step_product = 0;
    } else {
        const sch_real dt = K(t - row->last_at);
        sch_real v = 0, before = 0;
        if (kind == SCH_POSITION)
            v = K(4.0) * (s->P[3][3] + s->P[4][4] + s->P[5][5]) / K(3.0) * dt * dt;
        for (i = 0; i < 3; i++) {
            const sch_real step = y[i] - row->last[i];
            row->step_nis += step * step / (K(3.0) * (K(2.0) * R[4 * i] + v));
            before += step * row->step[i] / R[4 * i];
            row->step[i] = step;
        }
        row->step_product += before;
        row->steps += K(1.0);
    }
    row->count += K(1.0);
    row->last_at = t;
}

/* What becomes of a position or velocity beyond the gate. */
static int judge_rejected(sch_state *s, int kind, double t, sch_real nis, sch_real gate)
{
    const sch_real *y = s->work.y;
    sch_real *R = s->work.R, last, last_squared, n, rough, squared, first_squared, rate = 0;
    sch_fix_memory *row = memory_of(s, kind), *other = s->fix + (kind == SCH_POSITION ? 1 : 0);
    double dt, held, hold;
    int agrees, along, drifts, grows, i, smooth;
    dt = t - row->last_at;
    last = dot(y, row->last, R);
    last_squared = dot(row->last, row->last, R);
    remember(s, kind, t, nis, gate);
    for (i = 0; i < 3; i++)
        row->last[i] = y[i];
    n = row->count;
    if (SCH_ADAPTIVE && n <= 3) {
        const sch_real limited = nis < gate ? nis : gate;
        follow(s, row, limited, SQRT(limited / nis));
    }
    row->after_update = 0;
    if (n < 2)
        return SCH_REJECTED;
    rough = row->step_nis / row->steps;
    smooth = rough <= ROUGH;
    if (n >= 4 && !smooth && row->step_product < 0 && SCH_ADAPTIVE) {
        const sch_real before = row->r_scale;
        scale_fixes(row, rough);
        for (i = 0; i < 9; i++)
            R[i] *= row->r_scale / before;
        row->count = 0;
        if (sch_innovate(s, R, 3) > gate)
            return SCH_REJECTED;
        taken(s, row, t);
        return SCH_ACCEPTED;
    }
    if (row->drifted > 0 && (smooth || n >= 4))
        return readmit(s, kind, t, nis, gate, t - row->used_at);
    squared = dot(y, y, R);
    first_squared = dot(row->first, row->first, R);
    for (i = 0; i < 3; i++)
        rate += (y[i] - row->first[i]) * (y[i] - row->first[i]);
    held = t - row->first_at;
    rate = SQRT(rate) / K(held > 1e-3 ? held : 1e-3);
    agrees = other->used_at >= row->first_at && other->count == 0;
    agrees = agrees && (kind == SCH_VELOCITY || rate > EXCLUDES * other->sigma);
    along = last > K(0.8) * SQRT(squared * last_squared);
    grows = n >= 3 && along && (squared < last_squared ? squared : last_squared) > GROWN * GROWN * first_squared;
    drifts = n >= 4 && ((!smooth && row->step_product >= 0) || row->first_nis <= SLIGHT * gate);
    if ((grows || drifts) && !agrees) {
        if (SCH_ADAPTIVE)
            grow_noise(s, row, nis / K(3.0));
        return readmit(s, kind, t, nis, gate, t - row->used_at);
    }
    if (n >= 3 && smooth && other->count >= 3 && other->step_nis <= ROUGH * other->steps)
        return readmit(s, kind, t, nis, gate, t - row->used_at);
    hold = TRUST * (row->first_at - s->readmitted_at);
    hold = hold < SCH_HOLD_S ? hold : SCH_HOLD_S;
    if ((n >= 4 || (n >= 3 && smooth)) && held >= hold) {
        const sch_real *w = row->step;
        return jump(s, kind, t, SQRT(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) / K(dt > 1e-3 ? dt : 1e-3));
    }
    return SCH_REJECTED;
}

/* What becomes of a position or velocity. */
static int judge_fix(sch_state *s, int kind, double t, sch_real nis, sch_real gate)
{
    const sch_real *R = s->work.R;
    sch_fix_memory *row = memory_of(s, kind);
    row->sigma = SQRT((R[0] + R[4] + R[8]) / K(3.0));
    if (nis > gate)
        return judge_rejected(s, kind, t, nis, gate);
    if (row->count >= 3 && nis > 6) /* the gate has opened to a fault or a drift */
        return jump(s, kind, t, K(0.0));
    if (SCH_ADAPTIVE)
        follow(s, row, nis, K(1.0));
    taken(s, row, t);
    return SCH_ACCEPTED;
}

/* What becomes of a measurement by its normalised innovation; the covariance is enlarged for one that is forced in.
 *
 * Others than fixes are counted: after SCH_LOCKOUT rejections less acceptances one is taken. */
int sch_judge(sch_state *s, int kind, double t, sch_real nis, int d, sch_real gate)
{
    int *count = s->rejections + kind;
    if (!(nis >= 0) || nis > LARGEST)
        return SCH_REJECTED;
    if (SCH_LOCKOUT == 0 || gate > LARGEST)
        return nis > gate ? SCH_REJECTED : SCH_ACCEPTED;
    if (kind == SCH_POSITION || kind == SCH_VELOCITY)
        return judge_fix(s, kind, t, nis, gate);
    if (nis <= gate) {
        if (*count > 0)
            --*count;
        return SCH_ACCEPTED;
    }
    ++*count;
    if (*count <= SCH_LOCKOUT)
        return SCH_REJECTED;
    *count = d == 3 ? 0 : *count - 1;
    return SCH_FORCED;
}
