#include "monitor.h"

#include "constants.h"
#include "linalg.h"
#include "monitor_variables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Columns of the numbers of the machine: those of the tracker, masses at nodes, gains of sensors, what they read at
   rest. The matrices depend on the first ones and on the masses. */
enum { MASSES = N_PARAMETERS, GAINS = MASSES + N_NODES, RESTS = GAINS + N_SENSORS, COLUMNS = RESTS + N_SENSORS };
enum { MOVING = IN_MATRICES + N_NODES };

/* What is not known of the machine as it stands: the tracker's numbers, gains but the first, what is read at rest. */
enum { BASE = N_PARAMETERS + N_SENSORS - 1 + N_SENSORS };

/* A number that can change; printed from Python. */
static const struct {
    int cause, column;
} NUMBER[] = NUMBERS;
enum { N_NUMBERS = sizeof NUMBER / sizeof *NUMBER };

static const double K_B_STARTS[] = STARTS_K_B, DAMPING_STARTS[] = STARTS_DAMPING, MASS_STARTS[] = STARTS_MASS;
static const double K_B_WIDTHS[] = WIDTHS_K_B, DAMPING_WIDTHS[] = WIDTHS_DAMPING, MASS_WIDTHS[] = WIDTHS_MASS;
static const double GAIN_START[] = {0}, GAIN_WIDTH[] = {WIDTH_GAIN};
enum { MOST_STARTS = sizeof K_B_STARTS / sizeof *K_B_STARTS, GUESSES = MOST_STARTS * N_NUMBERS };

/* What is alike for the numbers of one cause. */
static const struct {
    double change, near;
    int n_starts;
    const double *starts, *widths;
} KIND[] = {
    [OF_K_B] = {CHANGE_OF_K_B, NEAR_K_B, sizeof K_B_STARTS / sizeof(double), K_B_STARTS, K_B_WIDTHS},
    [OF_DAMPING] = {CHANGE_OF_DAMPING, NEAR_DAMPING, sizeof DAMPING_STARTS / sizeof(double), DAMPING_STARTS,
                    DAMPING_WIDTHS},
    [OF_MASS] = {CHANGE_OF_MASS, NEAR_MASS, sizeof MASS_STARTS / sizeof(double), MASS_STARTS, MASS_WIDTHS},
    [OF_SENSOR] = {CHANGE_OF_GAIN, INFINITY, 1, GAIN_START, GAIN_WIDTH},
};

enum { ROW = 1 + COLUMNS }; /* an innovation and its derivatives */
enum { ONE_MORE = STATES + 1, STEP = STATES * WIDE, READ = N_SENSORS * SEEN };

/* A step of the motion and what is read, with first and second derivative by one number. */
typedef struct {
    double T[STEP], dT[STEP], ddT[STEP], Y[READ], dY[READ], ddY[READ];
} Linear;

/* A filter with one number free. All doubles, so that a state is its bytes. */
typedef struct {
    double number, value, at, x[STATES], P[ONE_MORE * ONE_MORE], log_weight, square;
} Guess;

typedef struct {
    double k_b;             /* that was believed when it began */
    double phase, instants; /* 0 listens, 1 watches, 2 has raised the alarm; instants of this phase */
    double step, before[3], loud, heard, point[N_PARAMETERS], noise; /* mean squares: of the force, of accelerations */
    double x[STATES], P[STATES * STATES], power[STATES], D[COLUMNS * STATES]; /* D: derivatives of x, by columns */
    double off[BASE], C[BASE * BASE], rough, size, worth;
    double G[BASE * N_NUMBERS], told[N_NUMBERS], tells[N_NUMBERS], bets[N_NUMBERS + 1];
    double likeness[N_SENSORS * (ORDER_OF_LIKENESS + 1)], foretell[N_SENSORS * ORDER_OF_LIKENESS];
    double past[N_SENSORS * ORDER_OF_LIKENESS * ROW]; /* innovations with derivatives, newest first */
    double drift, known_k_b, latest, doubt, cause, found, n;
    Guess guesses[GUESSES];
} State;

struct Monitor {
    ReducedRotor rotor;
    Belief belief;
    double alarm_every, learning;
    Tracker *tracker;
    State now;
    double stakes[N_NUMBERS + 1], modal_mass[N_NODES];
    double T[STEP], Y[READ], dT[MOVING * STEP], dY[MOVING * READ]; /* of the machine as it was learned */
    Linear one, linear[GUESSES];
    Room room;
    double up[STEP], down[STEP], Y_up[READ], Y_down[READ], moved[STEP], top[STATES * ONE_MORE];
};

static const int SENSOR[] = SENSOR_NODES;

static double dot(int n, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Column of a number that is not known of the machine as it stands. */
static int base_column(int i)
{
    if (i < N_PARAMETERS)
        return i;
    i -= N_PARAMETERS;
    return i < N_SENSORS - 1 ? GAINS + 1 + i : RESTS + i - (N_SENSORS - 1);
}

/* Column of a number that the matrices depend on. */
static int moving_column(int i)
{
    return i < IN_MATRICES ? i : MASSES + i - IN_MATRICES;
}

/* -- matrices ---------------------------------------------------------------------------------------------------- */

/* T and Y where the number of a column has a value. */
static void matrices(Monitor *s, int column, double value, double *T, double *Y)
{
    double point[N_PARAMETERS], rows[MOST_COORDINATES * SEEN];
    const int node = column < MASSES ? 0 : column - MASSES;
    const double mass = column < MASSES ? 0 : value * s->modal_mass[node];
    memcpy(point, s->now.point, sizeof point);
    if (column < IN_MATRICES)
        point[column] = value;
    reduced_accelerations(&s->rotor, point, node, mass, s->belief.driven, rows, &s->room);
    reduced_reading(&s->rotor, rows, N_SENSORS, SENSOR, Y);
    reduced_step(&s->rotor, rows, s->now.step, T, &s->room);
}

static void derivatives(int n, const double *up, const double *down, const double *middle, double *first, double *second)
{
    for (int i = 0; i < n; i++) {
        first[i] = (up[i] - down[i]) / (2 * DIFFERENCE);
        second[i] = (up[i] + down[i] - 2 * middle[i]) / (DIFFERENCE * DIFFERENCE);
    }
}

static void linearise_one(Monitor *s, int column, double at, Linear *l)
{
    const int n = 2 * s->rotor.r;
    matrices(s, column, at, l->T, l->Y);
    matrices(s, column, at + DIFFERENCE, s->up, s->Y_up);
    matrices(s, column, at - DIFFERENCE, s->down, s->Y_down);
    derivatives(n * (n + FORCES), s->up, s->down, l->T, l->dT, l->ddT);
    derivatives(N_SENSORS * (n + 1), s->Y_up, s->Y_down, l->Y, l->dY, l->ddY);
}

static void linearise_guess(Monitor *s, int k)
{
    const Guess *g = s->now.guesses + k;
    const int which = (int)g->number;
    if (NUMBER[which].cause == OF_SENSOR)
        linearise_one(s, STIFFNESS, s->now.point[STIFFNESS], s->linear + k);
    else
        linearise_one(s, NUMBER[which].column, g->at, s->linear + k);
}

/* Matrices of the machine as it was learned, their derivatives by all numbers, and those of the guesses. */
static void linearise(Monitor *s)
{
    for (int i = 0; i < MOVING; i++) {
        const int column = moving_column(i);
        linearise_one(s, column, column < N_PARAMETERS ? s->now.point[column] : 0, &s->one);
        if (!i) {
            memcpy(s->T, s->one.T, sizeof s->T);
            memcpy(s->Y, s->one.Y, sizeof s->Y);
        }
        memcpy(s->dT + i * STEP, s->one.dT, sizeof s->one.dT);
        memcpy(s->dY + i * READ, s->one.dY, sizeof s->one.dY);
    }
    for (int k = 0; k < (int)s->now.n; k++)
        linearise_guess(s, k);
}

/* -- watching ---------------------------------------------------------------------------------------------------- */

static double precision(int which)
{
    const double change = KIND[NUMBER[which].cause].change;
    return 1 / (change * change);
}

/* Watch a machine that is known but for the covariance of its numbers, in C already. */
static void start_watch(Monitor *s)
{
    static const double least[N_PARAMETERS] = LEAST_DOUBT;
    State *o = &s->now;
    for (int i = 0; i < N_PARAMETERS; i++)
        o->C[i * (BASE + 1)] += least[i] * least[i];
    for (int i = N_PARAMETERS; i < BASE; i++) {
        for (int j = 0; j < BASE; j++)
            o->C[i * BASE + j] = o->C[j * BASE + i] = 0;
        o->C[i * (BASE + 1)] = base_column(i) < RESTS ? GAINS_APART * GAINS_APART : AT_REST * AT_REST * o->heard;
    }
    memset(o->off, 0, sizeof o->off);
    memset(o->D, 0, sizeof o->D);
    memset(o->G, 0, sizeof o->G);
    memset(o->tells, 0, sizeof o->tells);
    memset(o->bets, 0, sizeof o->bets);
    memset(o->likeness, 0, sizeof o->likeness);
    memset(o->foretell, 0, sizeof o->foretell);
    memset(o->past, 0, sizeof o->past);
    for (int i = 0; i < N_NUMBERS; i++)
        o->told[i] = precision(i);
    o->drift = o->latest = o->n = 0;
    o->rough = o->size = 1;
    o->worth = WORTH_FIRST;
    o->cause = NONE;
    o->found = exp(o->point[STIFFNESS]);
    o->phase = 1;
    o->instants = 0;
    linearise(s);
}

static void hear(Monitor *s, double force, const double *read)
{
    State *o = &s->now;
    Learned learned;
    const int n = 2 * s->rotor.r, all = n + N_PARAMETERS;
    tracker_step(s->tracker, o->step, force, read);
    if (!tracker_lasted(o->instants, o->step, s->learning) || !tracker_learned(s->tracker, &learned))
        return;
    memcpy(o->x, learned.x, sizeof o->x);
    memcpy(o->power, learned.power, sizeof o->power);
    memcpy(o->point, learned.point, sizeof o->point);
    for (int i = 0; i < n; i++)
        memcpy(o->P + i * n, learned.P + i * all, (size_t)n * sizeof *o->P);
    for (int i = 0; i < N_PARAMETERS; i++)
        for (int j = 0; j < N_PARAMETERS; j++)
            o->C[i * BASE + j] = LEARNED * learned.P[(n + i) * all + n + j];
    o->noise = learned.noise;
    o->loud = learned.loud_force;
    o->heard = learned.loud;
    start_watch(s);
}

/* What is left of an innovation without what is not known of the machine. */
static double left_of(const State *o, const double *row)
{
    double left = row[0];
    for (int i = 0; i < BASE; i++)
        left -= row[1 + base_column(i)] * o->off[i];
    return left;
}

/* How an innovation follows from those before; a small system, solved as any other. */
static void learn_likeness(State *o, int q)
{
    enum { N = ORDER_OF_LIKENESS };
    const double *likeness = o->likeness + q * (N + 1);
    double A[N * N], *b = o->foretell + q * N;
    int rows[N];
    for (int i = 0; i < N; i++) {
        b[i] = likeness[i + 1];
        for (int j = 0; j < N; j++)
            A[i * N + j] = likeness[abs(i - j)] * (i == j ? 1 + 1e-9 : 1);
    }
    if (la_lu(N, A, rows))
        memset(b, 0, N * sizeof *b);
    else
        la_lu_solve(N, A, rows, 1, b);
}

/* An innovation and its derivatives less what those before foretell, as far as that has been learned. */
static void whiten(State *o, int q, const double *row, double *white)
{
    double *past = o->past + q * ORDER_OF_LIKENESS * ROW;
    const double *foretell = o->foretell + q * ORDER_OF_LIKENESS;
    if (!tracker_lasted(o->instants, o->step, COMPARED_FOR)) {
        double *likeness = o->likeness + q * (ORDER_OF_LIKENESS + 1);
        const double now = left_of(o, row);
        likeness[0] += now * now;
        for (int k = 0; k < ORDER_OF_LIKENESS; k++)
            likeness[k + 1] += now * left_of(o, past + k * ROW);
    } else if (!tracker_lasted(o->instants - 1, o->step, COMPARED_FOR) && o->likeness[q * (ORDER_OF_LIKENESS + 1)] > 0) {
        learn_likeness(o, q);
        if (!q) {
            o->size = 1;
            o->worth = WORTH_FIRST;
        }
    }
    memcpy(white, row, ROW * sizeof *white);
    for (int k = 0; k < ORDER_OF_LIKENESS; k++)
        for (int c = 0; c < ROW; c++)
            white[c] -= foretell[k] * past[k * ROW + c];
    memmove(past + ROW, past, (ORDER_OF_LIKENESS - 1) * ROW * sizeof *past);
    memcpy(past, row, ROW * sizeof *past);
}

/* One innovation more for all bets, and for what is not known of the machine. */
static void bet(Monitor *s, double off, double variance, const double *dy)
{
    State *o = &s->now;
    double S[BASE], CS[BASE], gain[BASE];
    for (int i = 0; i < BASE; i++)
        S[i] = dy[base_column(i)];
    for (int i = 0; i < BASE; i++)
        CS[i] = dot(BASE, o->C + i * BASE, S);
    variance = dot(BASE, S, CS) + variance * o->size;
    off -= dot(BASE, S, o->off);
    for (int i = 0; i < BASE; i++)
        gain[i] = CS[i] / variance;
    const double square = o->latest = off * off / variance;
    const int runs = tracker_lasted(o->instants, o->step, GAUGED_FOR);
    double most = 0;
    for (int i = 0; i <= N_NUMBERS; i++) {
        double gained = (square * (1 - 1 / UNKNOWN_SQUARES) - log(UNKNOWN_SQUARES)) / 2;
        if (i < N_NUMBERS) {
            double *G = o->G + i * BASE;
            const double by = dy[NUMBER[i].column] - dot(BASE, S, G), spread = 1 + by * by / o->told[i] / variance;
            const double left = off - by * o->tells[i] / o->told[i];
            gained = (square - left * left / variance / spread - log(spread)) / 2;
            o->tells[i] += by * off / variance;
            o->told[i] += by * by / variance;
            for (int j = 0; j < BASE; j++)
                G[j] += gain[j] * by;
        }
        if (runs)
            o->bets[i] = fmax(o->bets[i], 0) + fmin(gained, MOST_OF_ONE);
        if (i < N_NUMBERS && o->bets[i] <= 0) {
            memset(o->G + i * BASE, 0, BASE * sizeof *o->G);
            o->tells[i] = 0;
            o->told[i] = precision(i);
        }
        most = i ? fmax(most, o->bets[i]) : o->bets[i];
    }
    for (int i = 0; i < BASE; i++) {
        o->off[i] += gain[i] * off;
        for (int j = 0; j < BASE; j++)
            o->C[i * BASE + j] -= gain[i] * CS[j];
    }
    o->worth = fmin(o->worth + 1, WORTH_MOST);
    o->size *= 1 + (fmin(square, LARGEST_SQUARE) - 1) / o->worth;
    double sum = 0;
    for (int i = 0; i <= N_NUMBERS; i++)
        sum += s->stakes[i] * exp(o->bets[i] - most);
    o->drift = most + log(sum);
}

/* The motion a step on; each reading is compared with what it should be, and corrects the motion. */
static void foretell(Monitor *s, const double *forces, double doubt, const double *read)
{
    State *o = &s->now;
    enum { n = 2 * COORDINATES, wide = n + FORCES, row = n + 1 }; /* known when this is compiled, which makes it faster */
    double u[WIDE], own[STATES], column[STATES], v[SEEN], PH[STATES], innovation[ROW], white[ROW];
    double *dy = innovation + 1; /* its derivatives */
    memcpy(u, o->x, (size_t)n * sizeof *u);
    memcpy(u + n, forces, FORCES * sizeof *u);
    for (int c = 0; c < COLUMNS; c++) {
        double *D = o->D + c * STATES;
        memcpy(column, D, (size_t)n * sizeof *D);
        for (int i = 0; i < n; i++)
            D[i] = dot(n, s->T + i * wide, column);
    }
    for (int m = 0; m < MOVING; m++) {
        double *D = o->D + moving_column(m) * STATES;
        for (int i = 0; i < n; i++)
            D[i] += dot(wide, s->dT + m * STEP + i * wide, u);
    }
    for (int i = 0; i < n; i++) {
        const double *T = s->T + i * wide;
        o->D[GAIN * STATES + i] += dot(FORCES, T + n, forces);
        own[i] = (T[n] + T[n + 1] + T[n + 2]) * doubt;
        o->x[i] = dot(wide, T, u);
        for (int j = 0; j < n; j++)
            s->top[i * n + j] = dot(n, T, o->P + j * n); /* P is symmetric */
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            o->P[i * n + j] = o->P[j * n + i] = dot(n, s->top + i * n, s->T + j * wide) + own[i] * own[j];
    for (int q = 0; q < N_SENSORS; q++) {
        const double *Y = s->Y + q * row;
        memcpy(v, o->x, (size_t)n * sizeof *v);
        v[n] = forces[FORCES - 1];
        const double foretold = dot(row, Y, v), off = read[q] - foretold;
        for (int c = 0; c < COLUMNS; c++)
            dy[c] = dot(n, Y, o->D + c * STATES);
        for (int m = 0; m < MOVING; m++)
            dy[moving_column(m)] += dot(row, s->dY + m * READ + q * row, v);
        dy[GAIN] += Y[n] * v[n];
        dy[GAINS + q] += foretold;
        dy[RESTS + q] += 1;
        for (int i = 0; i < n; i++)
            PH[i] = dot(n, o->P + i * n, Y);
        const double variance = dot(n, Y, PH) + o->noise * o->noise;
        innovation[0] = off;
        whiten(o, q, innovation, white);
        bet(s, white[0], variance, white + 1);
        const double left = left_of(o, innovation);
        o->rough *= 1 + (fmin(left * left / variance / o->rough, LARGEST_SQUARE) - 1) / o->worth;
        const double share = fmin(1, OUTLIER * sqrt(variance * o->rough) / fmax(fabs(off), 1e-300)) / variance;
        for (int i = 0; i < n; i++)
            o->x[i] += PH[i] * share * off;
        for (int c = 0; c < COLUMNS; c++)
            for (int i = 0; i < n; i++)
                o->D[c * STATES + i] -= PH[i] * share * dy[c];
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                o->P[i * n + j] -= PH[i] * PH[j] / variance;
    }
    for (int i = 0; i < n; i++)
        o->power[i] += (o->x[i] * o->x[i] - o->power[i]) * fmin(1, o->step / REMEMBERED);
}

/* -- naming ------------------------------------------------------------------------------------------------------ */

/* Filters begin, each with another number free. */
static void alarm(Monitor *s, double k_b)
{
    State *o = &s->now;
    const int n = 2 * s->rotor.r, one_more = n + 1;
    o->n = 0;
    for (int which = 0; which < N_NUMBERS; which++) {
        const int cause = NUMBER[which].cause, column = NUMBER[which].column;
        int several = 0;
        for (int i = 0; i < N_NUMBERS; i++)
            several += NUMBER[i].cause == cause ? KIND[cause].n_starts : 0;
        for (int i = 0; i < KIND[cause].n_starts; i++) {
            Guess *g = o->guesses + (int)o->n;
            const double width = KIND[cause].widths[i];
            memset(g, 0, sizeof *g);
            g->number = which;
            g->value = g->at = (column < N_PARAMETERS ? o->point[column] : 0) + KIND[cause].starts[i];
            g->log_weight = -log(several);
            g->square = 1;
            memcpy(g->x, o->x, sizeof g->x);
            for (int j = 0; j < n; j++) {
                memcpy(g->P + j * one_more, o->P + j * n, (size_t)n * sizeof *g->P);
                g->P[j * one_more + j] += DOUBT * o->power[j];
            }
            g->P[n * one_more + n] = width * width;
            linearise_guess(s, (int)o->n++);
        }
    }
    o->known_k_b = k_b;
    o->phase = 2;
    o->instants = 0;
    o->cause = UNKNOWN;
    o->doubt = fmax(DOUBTED, o->latest);
}

static void follow(Monitor *s, int k)
{
    Guess *g = s->now.guesses + k;
    if (fabs(g->value - g->at) > KIND[NUMBER[(int)g->number].cause].near) {
        g->at = g->value;
        linearise_guess(s, k);
    }
}

static void predict(Monitor *s, int k, const double *forces, double doubt)
{
    Guess *g = s->now.guesses + k;
    const Linear *l = s->linear + k;
    const int n = 2 * s->rotor.r, wide = n + FORCES, one_more = n + 1;
    const int sensor = NUMBER[(int)g->number].cause == OF_SENSOR;
    const double by = sensor ? 0 : g->value - g->at;
    double u[WIDE], J[STATES], own[STATES], moved[STATES];
    memcpy(u, g->x, (size_t)n * sizeof *u);
    memcpy(u + n, forces, FORCES * sizeof *u);
    for (int i = 0; i < n * wide; i++)
        s->moved[i] = l->T[i] + by * l->dT[i] + by * by / 2 * l->ddT[i];
    for (int i = 0; i < n; i++) {
        const double *T = s->moved + i * wide;
        moved[i] = dot(wide, T, u);
        own[i] = (T[n] + T[n + 1] + T[n + 2]) * doubt;
        J[i] = sensor ? 0 : dot(wide, l->dT + i * wide, u) + by * dot(wide, l->ddT + i * wide, u);
        for (int j = 0; j <= n; j++)
            s->top[i * one_more + j] = dot(n, T, g->P + j * one_more) + J[i] * g->P[j * one_more + n];
    }
    memcpy(g->x, moved, (size_t)n * sizeof *moved);
    for (int i = 0; i < n; i++) {
        const double *top = s->top + i * one_more;
        for (int j = 0; j <= i; j++) {
            const double both = dot(n, top, s->moved + j * wide) + top[n] * J[j] + own[i] * own[j] * s->now.rough;
            g->P[i * one_more + j] = g->P[j * one_more + i] = both;
        }
        g->P[i * one_more + n] = g->P[n * one_more + i] = top[n];
        g->P[i * one_more + i] += MODEL_DOUBT * s->now.step * s->now.power[i];
    }
}

static void correct(Monitor *s, int k, double force, const double *read)
{
    const State *o = &s->now;
    Guess *g = s->now.guesses + k;
    const Linear *l = s->linear + k;
    const int n = 2 * s->rotor.r, row = n + 1, one_more = n + 1, cause = NUMBER[(int)g->number].cause;
    const double noise = o->noise * o->noise * o->rough * o->doubt;
    double total = 0, v[SEEN], Y[SEEN], H[ONE_MORE], PH[ONE_MORE];
    for (int q = 0; q < N_SENSORS; q++) {
        const double *Y0 = l->Y + q * row, *dY = l->dY + q * row, *ddY = l->ddY + q * row;
        memcpy(v, g->x, (size_t)n * sizeof *v);
        v[n] = force;
        double J;
        if (cause == OF_SENSOR) {
            const double own = NUMBER[(int)g->number].column == GAINS + q;
            for (int i = 0; i < row; i++)
                Y[i] = Y0[i] * (1 + g->value * own);
            J = dot(row, Y0, v) * own;
        } else {
            const double by = g->value - g->at;
            for (int i = 0; i < row; i++)
                Y[i] = Y0[i] + by * dY[i] + by * by / 2 * ddY[i];
            J = dot(row, dY, v) + by * dot(row, ddY, v);
        }
        memcpy(H, Y, (size_t)n * sizeof *H);
        H[n] = J;
        for (int i = 0; i < one_more; i++)
            PH[i] = dot(one_more, g->P + i * one_more, H);
        const double off = read[q] - dot(row, Y, v), variance = dot(one_more, H, PH) + noise;
        const double square = off * off / variance;
        const double counts = square < OUTLIER * OUTLIER ? square : 2 * OUTLIER * sqrt(square) - OUTLIER * OUTLIER;
        const double share = off / variance * fmin(1, OUTLIER / sqrt(fmax(square, 1e-300)));
        const double step = fmin(fmax(PH[n] * share, -FARTHEST_STEP), FARTHEST_STEP);
        g->log_weight -= (log(variance / noise) + counts) / 2;
        for (int i = 0; i < n; i++)
            g->x[i] += PH[i] * share;
        g->value += step;
        for (int i = 0; i < one_more; i++)
            for (int j = 0; j < one_more; j++)
                g->P[i * one_more + j] -= PH[i] * PH[j] / variance;
        if (cause != OF_SENSOR) /* what the linear step leaves out */
            g->P[one_more * one_more - 1] += step * step * step * step / 4;
        total += square;
    }
    g->square = total / N_SENSORS;
    if (cause == OF_K_B)
        g->value = fmin(fmax(g->value, log(s->rotor.least_k_b)), log(s->rotor.most_k_b));
    else if (cause == OF_MASS)
        g->value = fmax(g->value, LEAST_MASS);
}

static int most_likely(const State *o)
{
    int best = 0;
    for (int k = 1; k < (int)o->n; k++)
        if (o->guesses[k].log_weight > o->guesses[best].log_weight)
            best = k;
    return best;
}

/* Filters that are far behind end. */
static void drop(Monitor *s, double behind)
{
    State *o = &s->now;
    int left = 0;
    for (int k = 0; k < (int)o->n; k++) {
        if (o->guesses[k].log_weight < -behind)
            continue;
        if (left != k) {
            o->guesses[left] = o->guesses[k];
            s->linear[left] = s->linear[k];
        }
        left++;
    }
    o->n = left;
}

static void name(Monitor *s, const double *forces, double doubt, const double *read)
{
    State *o = &s->now;
    for (int k = 0; k < (int)o->n; k++) {
        follow(s, k);
        predict(s, k, forces, doubt);
        correct(s, k, forces[FORCES - 1], read);
    }
    const double most = o->guesses[most_likely(o)].log_weight;
    const int nameable = tracker_lasted(o->instants, o->step, NAMED_AFTER);
    for (int k = 0; k < (int)o->n; k++)
        o->guesses[k].log_weight = (o->guesses[k].log_weight - most) * (1 - fmin(1, o->step / FORGOTTEN));
    if (nameable)
        drop(s, tracker_lasted(o->instants, o->step, KEPT) ? BEHIND : BEHIND_EARLY);
    const Guess *best = o->guesses + most_likely(o);
    const int cause = NUMBER[(int)best->number].cause;
    double same = 0, all = 0;
    for (int k = 0; k < (int)o->n; k++) {
        const double weight = exp(o->guesses[k].log_weight);
        all += weight;
        same += NUMBER[(int)o->guesses[k].number].cause == cause ? weight : 0;
    }
    o->doubt = fmax(1, o->doubt * exp((fmin(best->square, LARGEST_SQUARE) - 1) * fmin(1, o->step / FOLLOWED)));
    o->cause = same > SURE * all && nameable && o->doubt < DOUBTFUL ? cause : UNKNOWN;
    o->found = exp((int)o->cause == OF_K_B ? best->value : o->point[STIFFNESS]);
}

/* Watch on from the k_b that was found. */
static void take_for_known(Monitor *s)
{
    State *o = &s->now;
    const Guess *best = o->guesses + most_likely(o);
    const int n = 2 * s->rotor.r, one_more = n + 1;
    o->point[STIFFNESS] = best->value;
    for (int i = STIFFNESS + 1; i < N_PARAMETERS; i++)
        o->point[i] += o->off[i];
    memcpy(o->x, best->x, sizeof o->x);
    for (int i = 0; i < n; i++)
        memcpy(o->P + i * n, best->P + i * one_more, (size_t)n * sizeof *o->P);
    o->C[STIFFNESS * (BASE + 1)] += LEARNED * best->P[one_more * one_more - 1];
    start_watch(s);
}

/* -- from outside ------------------------------------------------------------------------------------------------ */

Monitor *monitor_new(const ReducedRotor *rotor)
{
    Monitor *s = calloc(1, sizeof *s);
    if (!s)
        return 0;
    s->rotor = *rotor;
    s->tracker = tracker_new(rotor, N_SENSORS, SENSOR);
    if (!s->tracker) {
        free(s);
        return 0;
    }
    double most = 0;
    int count[UNKNOWN + 1] = {0}, kinds = 1;
    for (int i = 0; i < N_NODES; i++)
        most = fmax(most, dot(rotor->r, rotor->nodes + i * rotor->r, rotor->nodes + i * rotor->r));
    for (int i = 0; i < N_NODES; i++) {
        const double square = dot(rotor->r, rotor->nodes + i * rotor->r, rotor->nodes + i * rotor->r);
        s->modal_mass[i] = 1 / fmax(square, LEAST_MOTION * most);
    }
    for (int i = 0; i < N_NUMBERS; i++)
        kinds += !count[NUMBER[i].cause]++;
    for (int i = 0; i < N_NUMBERS; i++)
        s->stakes[i] = 1.0 / (kinds * count[NUMBER[i].cause]);
    s->stakes[N_NUMBERS] = 1.0 / kinds;
    return s;
}

void monitor_free(Monitor *monitor)
{
    if (monitor)
        tracker_free(monitor->tracker);
    free(monitor);
}

static void believe(Monitor *s, double k_b)
{
    s->belief.start[STIFFNESS] = log(k_b);
    tracker_start(s->tracker, &s->belief);
}

void monitor_start(Monitor *s, const Belief *belief, double alarm_every, double learning)
{
    s->belief = *belief;
    s->alarm_every = alarm_every;
    s->learning = learning;
    memset(&s->now, 0, sizeof s->now);
    s->now.k_b = exp(belief->start[STIFFNESS]);
    believe(s, s->now.k_b);
}

static int has_begun(const Monitor *s)
{
    return s->now.phase > 0 || s->now.instants > 0;
}

void monitor_step(Monitor *s, double step, double force, const double *read, double k_b)
{
    State *o = &s->now;
    if (!has_begun(s)) {
        o->k_b = k_b;
        believe(s, k_b);
        o->before[0] = o->before[1] = o->before[2] = force;
    }
    const int other = fabs(step - o->step) > 1e-9 * step;
    o->step = step;
    o->instants++;
    if (!o->phase)
        hear(s, force, read);
    else {
        if (other)
            linearise(s);
        const double g = exp(o->point[GAIN]), forces[] = {g * o->before[1], g * o->before[0], g * force};
        const double third = force - 3 * o->before[0] + 3 * o->before[1] - o->before[2];
        o->loud += (force * force - o->loud) * fmin(1, o->step / REMEMBERED);
        const double doubt = hypot(FORCE_DOUBT * sqrt(o->loud), THIRD_DIFFERENCE_DOUBT * third);
        if (o->phase == 1) {
            foretell(s, forces, doubt, read);
            if (o->drift >= log(s->alarm_every))
                alarm(s, k_b);
        } else
            name(s, forces, doubt, read);
        if ((int)o->cause == OF_K_B && k_b != o->known_k_b && fabs(log(k_b / o->found)) < TAKEN_FOR_KNOWN)
            take_for_known(s);
    }
    o->before[2] = o->before[1];
    o->before[1] = o->before[0];
    o->before[0] = force;
}

double monitor_drift(const Monitor *s)
{
    return s->now.drift / log(10);
}

int monitor_alarm(const Monitor *s)
{
    return s->now.phase == 2;
}

int monitor_cause(const Monitor *s)
{
    return (int)s->now.cause;
}

double monitor_stiffness(const Monitor *s, double k_b)
{
    if (!has_begun(s)) /* it believes any */
        return k_b;
    return s->now.phase > 0 ? s->now.found : tracker_stiffness(s->tracker);
}

int monitor_size(void)
{
    return (int)(sizeof(State) / sizeof(double)) + tracker_size();
}

void monitor_save(const Monitor *s, double *state)
{
    memcpy(state, &s->now, sizeof s->now);
    tracker_save(s->tracker, state + sizeof(State) / sizeof(double));
}

/* Whether a number can be the place of something. */
static int is_place(double number, double end)
{
    return number >= 0 && number < end && number == floor(number);
}

int monitor_restore(Monitor *s, const Belief *belief, double alarm_every, double learning, const double *state)
{
    State o;
    Belief then = *belief;
    memcpy(&o, state, sizeof o);
    if (!is_place(o.phase, 3) || !is_place(o.cause, UNKNOWN + 1) || !is_place(o.n, GUESSES + 1) || !(o.step >= 0) ||
        !(o.k_b > 0) || (o.phase == 2 && !o.n))
        return 1;
    for (int k = 0; k < (int)o.n; k++)
        if (!is_place(o.guesses[k].number, N_NUMBERS))
            return 1;
    then.start[STIFFNESS] = log(o.k_b);
    if (tracker_restore(s->tracker, &then, state + sizeof(State) / sizeof(double)))
        return 1;
    s->belief = then;
    s->alarm_every = alarm_every;
    s->learning = learning;
    s->now = o;
    if (o.phase > 0)
        linearise(s);
    return 0;
}
