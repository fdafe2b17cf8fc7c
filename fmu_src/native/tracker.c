#include "tracker.h"

#include "constants.h"
#include "linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Room for a row of a covariance, for what is read, for a step of the motion. */
enum { ALL = STATES + N_PARAMETERS + 3, READ = MOST_SENSORS * SEEN, MOVED = STATES * WIDE };

/* How far a parameter may be from where the matrices were made. */
static const double NEAR[IN_MATRICES] = ALL_NEAR;

static const double OFFSETS[] = ALL_OFFSETS;
enum { FILTERS = sizeof OFFSETS / sizeof *OFFSETS };

/* A step of the motion, x' = T (x, forces), and what is read, Y (x, force), with their derivatives by the parameters. */
typedef struct {
    double T[MOVED], dT[IN_MATRICES][MOVED], ddT[MOVED];
    double Y[READ], dY[IN_MATRICES][READ], ddY[READ];
} Linear;

/* All doubles, so that a state is its bytes. */
typedef struct {
    double x[STATES], parameters[N_PARAMETERS], at[N_PARAMETERS], P[ALL * ALL], power[STATES];
    double log_weight, contradiction;
} Filter;

typedef struct {
    Filter filters[FILTERS];
    double n, best, age;      /* filters that run, the best of them, instants since there are several */
    double count, last_alarm, first_alarm; /* instants; those of alarms that follow each other */
    double step, before[3];   /* forces of the instants before [N] */
    double past[PAST], newest, likeness[ORDER * ORDER], rich;
    double loud, window, gauged; /* mean square acceleration; that of a window, and instants that it was taken over */
    double noise, caution, calming, contradiction, longest, together;
} State;

struct Tracker {
    ReducedRotor rotor;
    Belief belief;
    int n_sensors, nodes[MOST_SENSORS], known;
    State now;
    Linear linear[FILTERS];
    Room room;
    double up[MOVED], down[MOVED], Y_up[READ], Y_down[READ];
    double T[MOVED], W[STATES * ALL], top[STATES * ALL];
};

static double dot(int n, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* -- matrices ---------------------------------------------------------------------------------------------------- */

/* T and Y at some parameters. */
static void matrices(Tracker *s, const double *p, double *T, double *Y)
{
    double rows[MOST_COORDINATES * SEEN];
    reduced_accelerations(&s->rotor, p, 0, 0, s->belief.driven, rows, &s->room);
    reduced_reading(&s->rotor, rows, s->n_sensors, s->nodes, Y);
    reduced_step(&s->rotor, rows, s->now.step, T, &s->room);
}

static void difference(int n, const double *up, const double *down, double over, double *out)
{
    for (int i = 0; i < n; i++)
        out[i] = (up[i] - down[i]) / over;
}

static void curvature(int n, const double *up, const double *down, const double *middle, double *out)
{
    for (int i = 0; i < n; i++)
        out[i] = (up[i] + down[i] - 2 * middle[i]) / (DIFFERENCE * DIFFERENCE);
}

/* Make the matrices of a filter anew, where its parameters are. */
static void linearise(Tracker *s, int which)
{
    const int n = 2 * s->rotor.r, moved = n * (n + FORCES), read = s->n_sensors * (n + 1);
    Linear *l = s->linear + which;
    const double *at = s->now.filters[which].at;
    double p[N_PARAMETERS];
    matrices(s, at, l->T, l->Y);
    for (int j = 0; j < IN_MATRICES; j++) {
        memcpy(p, at, sizeof p);
        p[j] = at[j] + DIFFERENCE;
        matrices(s, p, s->up, s->Y_up);
        p[j] = at[j] - DIFFERENCE;
        matrices(s, p, s->down, s->Y_down);
        difference(moved, s->up, s->down, 2 * DIFFERENCE, l->dT[j]);
        difference(read, s->Y_up, s->Y_down, 2 * DIFFERENCE, l->dY[j]);
        if (j == STIFFNESS) {
            curvature(moved, s->up, s->down, l->T, l->ddT);
            curvature(read, s->Y_up, s->Y_down, l->Y, l->ddY);
        }
    }
}

static void follow(Tracker *s, int which)
{
    Filter *f = s->now.filters + which;
    int far = 0;
    for (int j = 0; j < IN_MATRICES; j++)
        far |= fabs(f->parameters[j] - f->at[j]) > NEAR[j];
    if (!far)
        return;
    memcpy(f->at, f->parameters, sizeof f->at);
    linearise(s, which);
}

/* -- one filter -------------------------------------------------------------------------------------------------- */

/* ``doubt``: standard error of the force between the instants. */
static void predict(Tracker *s, int which, double force, double doubt)
{
    Filter *f = s->now.filters + which;
    const Linear *l = s->linear + which;
    const int n = 2 * s->rotor.r, wide = n + FORCES, all = n + N_PARAMETERS;
    const double g = exp(f->parameters[GAIN]);
    double by[IN_MATRICES], u[WIDE], moved[STATES], own[STATES];
    for (int j = 0; j < IN_MATRICES; j++)
        by[j] = f->parameters[j] - f->at[j];
    for (int i = 0; i < n * wide; i++)
        s->T[i] = l->T[i] + by[0] * l->dT[0][i] + by[1] * l->dT[1][i] + by[2] * l->dT[2][i] + by[3] * l->dT[3][i] +
                  by[0] * by[0] / 2 * l->ddT[i];
    memcpy(u, f->x, (size_t)n * sizeof *u);
    u[n] = g * s->now.before[1], u[n + 1] = g * s->now.before[0], u[n + 2] = g * force;
    for (int i = 0; i < n; i++) {
        const double *T = s->T + i * wide;
        double *W = s->W + i * ALL;
        memcpy(W, T, (size_t)n * sizeof *W);
        for (int j = 0; j < IN_MATRICES; j++)
            W[n + j] = dot(wide, l->dT[j] + i * wide, u);
        W[n + STIFFNESS] += by[STIFFNESS] * dot(wide, l->ddT + i * wide, u);
        W[n + GAIN] = dot(FORCES, T + n, u + n);
        moved[i] = dot(wide, T, u);
        own[i] = (T[n] + T[n + 1] + T[n + 2]) * doubt;
    }
    memcpy(f->x, moved, (size_t)n * sizeof *moved);
    for (int i = 0; i < n; i++) {
        double *top = s->top + i * ALL;
        memset(top, 0, (size_t)all * sizeof *top);
        for (int k = 0; k < all; k++) {
            const double w = s->W[i * ALL + k], *P = f->P + k * ALL;
            for (int j = 0; j < all; j++)
                top[j] += w * P[j];
        }
    }
    for (int i = 0; i < n; i++) {
        const double *top = s->top + i * ALL;
        for (int j = 0; j <= i; j++)
            f->P[i * ALL + j] = f->P[j * ALL + i] = dot(all, top, s->W + j * ALL) + own[i] * own[j];
        for (int j = n; j < all; j++)
            f->P[i * ALL + j] = f->P[j * ALL + i] = top[j];
    }
    const int at = n + STIFFNESS;
    const double walk = s->now.n > 1 && s->now.longest == LONGEST ? FAST_WALK : s->belief.walk;
    f->P[at * ALL + at] += walk * walk * s->now.step;
}

/* What a sensor should read, and its derivatives H (all) by the state and the parameters. */
static double expected(const Tracker *s, int which, int sensor, double force, double *H)
{
    const Filter *f = s->now.filters + which;
    const Linear *l = s->linear + which;
    const int n = 2 * s->rotor.r, row = n + 1, first = sensor * row;
    double v[SEEN], Y[SEEN], by[IN_MATRICES];
    memcpy(v, f->x, (size_t)n * sizeof *v);
    v[n] = exp(f->parameters[GAIN]) * force;
    for (int j = 0; j < IN_MATRICES; j++)
        by[j] = f->parameters[j] - f->at[j];
    for (int i = 0; i < row; i++) {
        const int k = first + i;
        Y[i] = l->Y[k] + by[0] * l->dY[0][k] + by[1] * l->dY[1][k] + by[2] * l->dY[2][k] + by[3] * l->dY[3][k] +
               by[0] * by[0] / 2 * l->ddY[k];
    }
    memcpy(H, Y, (size_t)n * sizeof *H);
    for (int j = 0; j < IN_MATRICES; j++)
        H[n + j] = dot(row, l->dY[j] + first, v);
    H[n + STIFFNESS] += by[STIFFNESS] * dot(row, l->ddY + first, v);
    H[n + GAIN] = Y[n] * v[n];
    return dot(row, Y, v);
}

/* Squared innovation over its variance, in the mean of the sensors; the log-likelihood goes to the filter's weight. */
static double correct(Tracker *s, int which, double force, const double *read)
{
    Filter *f = s->now.filters + which;
    const int n = 2 * s->rotor.r, all = n + N_PARAMETERS, at = n + STIFFNESS;
    /* What a force of few frequencies cannot tell is considered, and not estimated: its errors stay what they were. */
    const int estimated = s->now.rich ? all : s->known ? at + 1 : n;
    double total = 0;
    for (int q = 0; q < s->n_sensors; q++) {
        double H[ALL], PH[ALL];
        double off = read[q] - expected(s, which, q, force, H);
        for (int i = 0; i < all; i++)
            PH[i] = dot(all, f->P + i * ALL, H);
        const double variance = dot(all, H, PH) + s->now.noise * s->now.noise * s->now.caution;
        const double square = off * off / variance;
        if (square > OUTLIER * OUTLIER) /* counts no more than that */
            off *= OUTLIER / sqrt(square);
        const double own = square < FAR_OFF * FAR_OFF ? square : 2 * FAR_OFF * sqrt(square) - FAR_OFF * FAR_OFF;
        f->log_weight -= (log(variance) + own) / 2;
        double step[ALL];
        for (int i = 0; i < all; i++)
            step[i] = i < estimated ? PH[i] * off / variance : 0;
        step[at] = fmin(fmax(step[at], -FARTHEST), FARTHEST);
        for (int i = 0; i < n; i++)
            f->x[i] += step[i];
        for (int j = 0; j < N_PARAMETERS; j++)
            f->parameters[j] += step[n + j];
        for (int i = 0; i < all; i++) {
            const double gain = PH[i] / variance;
            const int end = i < estimated ? all : estimated;
            for (int j = 0; j < end; j++)
                f->P[i * ALL + j] -= gain * PH[j];
        }
        f->P[at * ALL + at] += step[at] * step[at] * step[at] * step[at] / 4; /* what the linear step leaves out */
        total += square;
    }
    for (int i = 0; i < n; i++)
        f->power[i] += (f->x[i] * f->x[i] - f->power[i]) * fmin(1, s->now.step / REMEMBERED);
    f->parameters[STIFFNESS] =
        fmin(fmax(f->parameters[STIFFNESS], log(s->rotor.least_k_b)), log(s->rotor.most_k_b));
    return total / s->n_sensors;
}

/* -- several filters --------------------------------------------------------------------------------------------- */

int tracker_lasted(double instants, double step, double seconds)
{
    return (instants + 0.5) * step >= seconds;
}

/* The measurements contradict the filter: others with other stiffnesses run beside it. */
static void alarm(Tracker *s)
{
    State *o = &s->now;
    const int n = 2 * s->rotor.r, all = n + N_PARAMETERS, at = n + STIFFNESS, best = (int)o->best;
    const int again = !tracker_lasted(o->count - o->last_alarm, o->step, AGAIN); /* not only the stiffness is wrong */
    if (best) {
        o->filters[0] = o->filters[best];
        s->linear[0] = s->linear[best];
    }
    for (int k = FILTERS - 1; k >= 0; k--) {
        Filter *f = o->filters + k;
        if (k) {
            *f = o->filters[0];
            s->linear[k] = s->linear[0];
        }
        f->parameters[STIFFNESS] += OFFSETS[k];
        f->log_weight = -OFFSETS[k] * OFFSETS[k] / (2 * SPREAD * SPREAD);
        for (int j = 0; j < n; j++)
            f->P[j * ALL + j] += DOUBT * f->power[j];
        for (int j = STIFFNESS; j < N_PARAMETERS; j++) {
            const double std = j == STIFFNESS ? WIDTH : DOUBTED_AGAIN * s->belief.std[j];
            if (j != STIFFNESS && !again)
                continue;
            for (int i = 0; i < all; i++)
                f->P[(n + j) * ALL + i] = f->P[i * ALL + n + j] = 0;
            f->P[(n + j) * ALL + n + j] = std * std;
        }
        f->P[at * ALL + at] = WIDTH * WIDTH;
    }
    o->n = FILTERS;
    o->longest = LONGEST, o->together = TOGETHER;
    o->best = o->age = 0;
    o->last_alarm = o->count;
    if (!again)
        o->first_alarm = o->count;
    o->caution = CAUTION_AFTER_ALARM;
    o->calming = CALMING_AFTER_ALARM;
    o->contradiction = 1;
}

/* Which filter is the best, and which go on beside it. */
static void choose(Tracker *s)
{
    State *o = &s->now;
    const int n = (int)o->n;
    int best = 0, left = 0;
    for (int k = 1; k < n; k++)
        if (o->filters[k].log_weight > o->filters[best].log_weight)
            best = k;
    const double most = o->filters[best].log_weight;
    o->age++;
    const int apart = tracker_lasted(o->age, o->step, o->together), at_last = tracker_lasted(o->age, o->step, o->longest);
    for (int k = 0; k < n; k++) {
        Filter *f = o->filters + k;
        f->log_weight -= most;
        if (n > 1 && k != best && apart && (f->log_weight < -HOPELESS || at_last))
            continue;
        if (k == best)
            o->best = left;
        if (left != k) {
            o->filters[left] = *f;
            s->linear[left] = s->linear[k];
        }
        left++;
    }
    o->n = left;
}

/* Whether the force is persistently exciting: whether its last values do not foretell each other. */
static void listen(Tracker *s, double force)
{
    State *o = &s->now;
    double A[ORDER * ORDER], f[ORDER];
    const double share = fmin(1, o->step / ENRICHED);
    const int lag = (int)fmin((PAST - 1) / ORDER, fmax(1, SHARE_OF_PERIOD / s->rotor.highest_hz / o->step));
    o->newest = ((int)o->newest + 1) % PAST;
    o->past[(int)o->newest] = force;
    for (int i = 0; i < ORDER; i++)
        f[i] = o->past[((int)o->newest - i * lag + PAST) % PAST];
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++)
            o->likeness[i * ORDER + j] += share * (f[i] * f[j] - o->likeness[i * ORDER + j]);
    memcpy(A, o->likeness, sizeof A);
    const double least = UNTOLD * A[0];
    o->rich = least > 0 && !la_cholesky(ORDER, A);
    for (int i = 0; i < ORDER; i++)
        o->rich = o->rich && A[i * (ORDER + 1)] * A[i * (ORDER + 1)] > least;
}

/* How loud the rotor is; whether that is known: at first it is taken until two windows agree. */
static int gauge(Tracker *s, const double *read)
{
    State *o = &s->now;
    const double square = dot(s->n_sensors, read, read) / s->n_sensors;
    if (o->n) {
        o->loud += (square - o->loud) * fmin(1, o->step / HEARD);
        return 1;
    }
    if (!(square > 0) && !o->gauged)
        return 0;
    o->gauged++;
    o->window += (square - o->window) / o->gauged;
    if (!tracker_lasted(o->gauged, o->step, GAUGED))
        return 0;
    const int steady = o->loud / STEADY < o->window && o->window < o->loud * STEADY;
    o->loud = o->window;
    o->window = o->gauged = 0;
    return steady;
}

/* First filters, with stiffnesses about the one believed, for a motion as large as the accelerations say. */
static void begin(Tracker *s)
{
    State *o = &s->now;
    const ReducedRotor *R = &s->rotor;
    const int r = R->r, n = 2 * r;
    Filter *f = o->filters;
    double w[MOST_COORDINATES], loud[MOST_COORDINATES * MOST_COORDINATES];
    double *K = s->room.A, *M = K + r * r, *Phi = M + r * r;
    for (int i = 0; i < r * r; i++) {
        K[i] = R->K_fixed[i] + exp(f->parameters[STIFFNESS]) * R->K_bearing[i];
        M[i] = expm1(f->parameters[DISK_MASS]) * R->M_disks[i] + (i % (r + 1) == 0);
    }
    la_modes(r, K, M, w, Phi, s->room.some);
    for (int i = 0; i < r * r; i++) /* each mode as loud as all of them */
        loud[i] = LOUDEST * sqrt(o->loud) * Phi[i] / w[i % r];
    for (int i = 0; i < r; i++)
        for (int j = 0; j < r; j++)
            for (int m = 0; m < r; m++) {
                const double both = loud[i * r + m] * loud[j * r + m];
                f->P[i * ALL + j] += R->scale[i] * R->scale[j] * both;
                f->P[(r + i) * ALL + r + j] += w[m] * both;
            }
    for (int j = 0; j < N_PARAMETERS; j++)
        f->P[(n + j) * ALL + n + j] = s->belief.std[j] * s->belief.std[j];
    o->caution = CAUTION;
    o->calming = CALMING;
    o->contradiction = 1;
    const int several = o->rich || s->known; /* else nothing could tell them apart */
    const double share = s->belief.std[STIFFNESS] / SPREAD, std = several ? WIDTH * share : s->belief.std[STIFFNESS];
    f->P[(n + STIFFNESS) * (ALL + 1)] = std * std;
    o->n = several ? FILTERS : 1;
    for (int k = (int)o->n - 1; k >= 0; k--) {
        Filter *g = o->filters + k;
        if (k)
            *g = *f;
        g->parameters[STIFFNESS] += OFFSETS[k] * share;
        g->log_weight = -OFFSETS[k] * OFFSETS[k] / (2 * SPREAD * SPREAD);
        memcpy(g->at, g->parameters, sizeof g->at);
        linearise(s, k);
    }
    o->age = 0;
    o->longest = LONGEST_AT_FIRST;
    o->together = TOGETHER_AT_FIRST;
}

/* -- from outside ------------------------------------------------------------------------------------------------ */

Tracker *tracker_new(const ReducedRotor *rotor, int n_sensors, const int *nodes)
{
    Tracker *s = calloc(1, sizeof *s);
    if (!s)
        return 0;
    s->rotor = *rotor;
    s->n_sensors = n_sensors;
    memcpy(s->nodes, nodes, (size_t)n_sensors * sizeof *nodes);
    return s;
}

void tracker_free(Tracker *tracker)
{
    free(tracker);
}

static void believe(Tracker *s, const Belief *belief)
{
    s->belief = *belief;
    s->known = 1;
    for (int j = STIFFNESS + 1; j < N_PARAMETERS; j++)
        s->known = s->known && belief->std[j] == 0;
}

void tracker_start(Tracker *s, const Belief *belief)
{
    believe(s, belief);
    memset(&s->now, 0, sizeof s->now);
    memcpy(s->now.filters[0].parameters, belief->start, sizeof belief->start);
    s->now.last_alarm = s->now.first_alarm = -1e9;
}

static void run(Tracker *s, double force, const double *read)
{
    State *o = &s->now;
    o->noise = s->belief.noise > 0 ? s->belief.noise : NOISE_SHARE * sqrt(o->loud);
    const double third = force - 3 * o->before[0] + 3 * o->before[1] - o->before[2];
    const double doubt = hypot(FORCE_DOUBT * sqrt(o->likeness[0]), THIRD_DIFFERENCE_DOUBT * third);
    for (int k = 0; k < (int)o->n; k++) {
        follow(s, k);
        predict(s, k, force, doubt);
        o->filters[k].contradiction = correct(s, k, force, read);
    }
    choose(s);
    const double now = o->filters[(int)o->best].contradiction, samples = fmax(1, AVERAGED / o->step);
    o->contradiction += (fmin(now, UTMOST) - o->contradiction) / samples;
    o->caution -= (o->caution - 1) * fmin(1, o->step / o->calming);
    if (o->n > 1 || !(o->rich || s->known))
        return;
    if (tracker_lasted(o->count, o->step, SETTLED) && o->contradiction > 1 + ALARM / sqrt(samples * s->n_sensors))
        alarm(s);
}

void tracker_step(Tracker *s, double step, double force, const double *read)
{
    State *o = &s->now;
    const int other = fabs(step - o->step) > 1e-9 * step;
    o->step = step;
    if (!o->count++)
        o->before[0] = o->before[1] = o->before[2] = force;
    listen(s, force);
    for (int k = 0; other && k < (int)o->n; k++)
        linearise(s, k);
    if (gauge(s, read)) {
        if (!o->n)
            begin(s);
        run(s, force, read);
    }
    o->before[2] = o->before[1];
    o->before[1] = o->before[0];
    o->before[0] = force;
}

static const Filter *best_of(const Tracker *s)
{
    return s->now.filters + (int)s->now.best;
}

static int tells(const Tracker *s)
{
    return s->now.n == 1 && (s->now.rich || s->known);
}

double tracker_stiffness(const Tracker *s)
{
    return exp(best_of(s)->parameters[STIFFNESS]);
}

double tracker_error(const Tracker *s)
{
    const int at = 2 * s->rotor.r + STIFFNESS;
    return s->now.n ? sqrt(fmax(best_of(s)->P[at * ALL + at], 0)) : s->belief.std[STIFFNESS];
}

int tracker_valid(const Tracker *s)
{
    const State *o = &s->now;
    const double k_b = tracker_stiffness(s);
    const int restless = tracker_lasted(o->last_alarm - o->first_alarm, o->step, AGAIN);
    const int calm = !restless || tracker_lasted(o->count - o->last_alarm, o->step, AGAIN);
    return tells(s) && calm && o->contradiction < CONTRADICTED && tracker_error(s) < LARGEST_ERROR &&
           k_b > s->rotor.least_k_b && k_b < s->rotor.most_k_b;
}

int tracker_learned(const Tracker *s, Learned *learned)
{
    const State *o = &s->now;
    const Filter *f = best_of(s);
    const int n = 2 * s->rotor.r, all = n + N_PARAMETERS;
    if (!tells(s))
        return 0;
    memcpy(learned->point, f->parameters, sizeof f->parameters);
    memcpy(learned->x, f->x, sizeof f->x);
    memcpy(learned->power, f->power, sizeof f->power);
    for (int i = 0; i < all; i++)
        memcpy(learned->P + i * all, f->P + i * ALL, (size_t)all * sizeof *f->P);
    learned->noise = o->noise;
    learned->loud = o->loud;
    learned->loud_force = o->likeness[0];
    return 1;
}

int tracker_size(void)
{
    return sizeof(State) / sizeof(double);
}

void tracker_save(const Tracker *s, double *state)
{
    memcpy(state, &s->now, sizeof s->now);
}

/* Whether a number can be the place of something. */
static int is_place(double number, double end)
{
    return number >= 0 && number < end && number == floor(number);
}

int tracker_restore(Tracker *s, const Belief *belief, const double *state)
{
    State o;
    memcpy(&o, state, sizeof o);
    if (!is_place(o.n, FILTERS + 1) || !is_place(o.best, fmax(o.n, 1)) || !is_place(o.newest, PAST) || !(o.step >= 0))
        return 1;
    believe(s, belief);
    s->now = o;
    for (int k = 0; k < (int)o.n; k++)
        linearise(s, k);
    return 0;
}
