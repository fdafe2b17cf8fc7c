#include "tracker_network.h"

#include "constants.h"
#include "linalg.h"
#include "network_weights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Energies of a block, and what is seen of a span. */
enum { SIZE = 6 * CELLS + CHANNELS, SEEN = CELLS + 6, SEEING = TAPS * CHANNELS };

/* All doubles, so that a state is its bytes. The last TAPS instants of each channel stand in a ring, twice, so that they
   always lie beside each other; energies in a ring of blocks. */
typedef struct {
    double signals[CHANNELS * 2 * TAPS], energies[BLOCKS * SIZE], sum[SIZE];
    double before[CHANNELS], likeness[ORDER * ORDER], ln_k, error, beyond, phase;
    double newest, block, filled, heard; /* places in the rings; instants of this block, and since the rotor moved */
} State;

struct NetworkTracker {
    State now;
};

NetworkTracker *network_tracker_new(void)
{
    return calloc(1, sizeof(NetworkTracker));
}

void network_tracker_free(NetworkTracker *tracker)
{
    free(tracker);
}

void network_tracker_start(NetworkTracker *tracker, double ln_k, double error)
{
    memset(&tracker->now, 0, sizeof tracker->now);
    tracker->now.ln_k = ln_k;
    tracker->now.error = error;
    tracker->now.phase = -1;
    tracker->now.beyond = UNHEARD;
}

int network_tracker_node(void)
{
    return TRAINED_NODE;
}

static double clipped(double x, double least, double most)
{
    return x < least ? least : x > most ? most : x;
}

/* to (m) = bias + W x; W (n, m). */
static void dense(int m, int n, const float *restrict W, const float *restrict bias, const double *restrict x,
                  double *restrict to)
{
    for (int i = 0; i < m; i++)
        to[i] = bias ? bias[i] : 0;
    for (int j = 0; j < n; j++)
        for (int i = 0; i < m; i++)
            to[i] += W[j * m + i] * x[j];
}

/* x (n) = exp x over their sum. */
static void softmax(int n, double *x)
{
    double most = x[0], sum = 0;
    for (int i = 1; i < n; i++)
        most = fmax(most, x[i]);
    for (int i = 0; i < n; i++)
        sum += x[i] = exp(x[i] - most);
    for (int i = 0; i < n; i++)
        x[i] /= sum;
}

/* The answer of all cells to mean energies, over that of the last acceleration, and what else is seen. */
static double look(const double *energies, double *seen)
{
    double share[CELLS], each[5][CELLS], *means = seen + CELLS;
    const double *ee = energies, *ek = ee + CELLS, *em = ek + CELLS, *kk = em + CELLS, *km = kk + CELLS, *mm = km + CELLS;
    for (int i = 0; i < CELLS; i++) {
        const double a = kk[i] + RIDGE[0], b = mm[i] + RIDGE[1], alone = a * b - km[i] * km[i];
        const double x = clipped((em[i] * km[i] - ek[i] * b) / alone, -1, 1);
        const double y = clipped((ek[i] * km[i] - em[i] * a) / alone, -1, 1);
        const double left = ee[i] + 2 * (x * ek[i] + y * em[i] + x * y * km[i]) + x * x * kk[i] + y * y * mm[i];
        seen[i] = each[0][i] = log(fmax(left, 0) + LEAST_SHARE);
        each[1][i] = log(alone / b + LITTLE) - seen[i];
        each[2][i] = SIDES[i] + y;
        each[3][i] = LN_K[i] + PITCH[0] * x;
        each[4][i] = x * x;
        share[i] = BIAS[i] - SHARPNESS[0] * seen[i];
    }
    softmax(CELLS, share);
    for (int k = 0; k < 5; k++) {
        means[k] = 0;
        for (int i = 0; i < CELLS; i++)
            means[k] += share[i] * each[k][i];
    }
    means[5] = log(energies[6 * CELLS] + LITTLE);
    return means[3];
}

/* Energies over the last ``span`` blocks, over that of the last acceleration. */
static void average(const State *s, int span, double *energies)
{
    memset(energies, 0, SIZE * sizeof *energies);
    for (int back = span - 1; back >= 0; back--) {
        const double *row = s->energies + (((int)s->block - back + BLOCKS) % BLOCKS) * SIZE;
        for (int i = 0; i < SIZE; i++)
            energies[i] += row[i];
    }
    const double last = fmax(energies[SIZE - 1], TINY);
    for (int i = 0; i < SIZE; i++)
        energies[i] /= last;
}

/* The answers of all spans, the logarithms of their errors, and how far what is seen lies beyond the training. */
static double of_spans(const State *s, double *answers, double *doubts)
{
    static const int spans[] = SPANS;
    double energies[SIZE], seen[SEEN], hidden[NEURONS], own[2], beyond = -INFINITY;
    for (int k = 0; k < N_SPANS; k++) {
        average(s, spans[k], energies);
        answers[k] = look(energies, seen);
        for (int i = 0; i < SEEN; i++)
            beyond = fmax(beyond, fmax(LEAST[k * SEEN + i] - seen[i], seen[i] - MOST[k * SEEN + i]));
        dense(NEURONS, SEEN, HIDDEN_W, HIDDEN_B + k * NEURONS, seen, hidden);
        for (int i = 0; i < NEURONS; i++)
            hidden[i] = tanh(hidden[i]);
        dense(2, NEURONS, CORRECT_W, CORRECT_B, hidden, own);
        answers[k] += own[0];
        doubts[k] = own[1];
    }
    return beyond;
}

static void answer(State *s)
{
    double read[2 * N_SPANS], answers[N_SPANS], hidden[NEURONS], told[N_SPANS + 1];
    double *doubts = read + N_SPANS, ln_k = 0;
    s->beyond = of_spans(s, answers, doubts);
    for (int k = 0; k < N_SPANS; k++)
        read[k] = answers[k] - answers[N_SPANS - 1];
    dense(NEURONS, 2 * N_SPANS, WEIGH_W, WEIGH_B, read, hidden);
    for (int i = 0; i < NEURONS; i++)
        hidden[i] = tanh(hidden[i]);
    dense(N_SPANS + 1, NEURONS, ANSWER_W, ANSWER_B, hidden, told);
    double doubt = told[N_SPANS];
    for (int k = 0; k < N_SPANS; k++)
        told[k] -= doubts[k];
    softmax(N_SPANS, told);
    for (int k = 0; k < N_SPANS; k++) {
        ln_k += told[k] * answers[k];
        doubt += told[k] * doubts[k];
    }
    s->ln_k = ln_k + LN_K_REF[0];
    s->error = exp(clipped(doubt, LEAST_DOUBT, MOST_DOUBT)) * FACTOR[0];
}

/* Products of what every cell is off by, from the last instants. */
static void add_products(State *s)
{
    double seeing[SEEING], found[FILTERS], off[3 * CELLS];
    for (int c = 0; c < CHANNELS; c++)
        memcpy(seeing + c * TAPS, s->signals + c * 2 * TAPS + (int)s->newest, TAPS * sizeof *seeing);
    dense(FILTERS, SEEING, FILTERS_W, 0, seeing, found);
    dense(3 * CELLS, FILTERS, CELLS_W, 0, found, off);
    const double *e = off, *k = e + CELLS, *m = k + CELLS;
    double *sum = s->sum;
    for (int i = 0; i < CELLS; i++) {
        sum[i] += e[i] * e[i];
        sum[CELLS + i] += e[i] * k[i];
        sum[2 * CELLS + i] += e[i] * m[i];
        sum[3 * CELLS + i] += k[i] * k[i];
        sum[4 * CELLS + i] += k[i] * m[i];
        sum[5 * CELLS + i] += m[i] * m[i];
    }
}

/* Whether the force's last values do not foretell each other, a block having been heard. */
static int is_rich(State *s)
{
    const double share = fmin(1, BLOCK * STEP / ENRICHED), *newest = s->signals + (int)s->newest + TAPS - 1;
    double A[ORDER * ORDER];
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
            double sum = 0;
            for (int back = BLOCK - 1; back >= 0; back--)
                sum += newest[-back - i * LAG] * newest[-back - j * LAG];
            s->likeness[i * ORDER + j] += share * (sum - s->likeness[i * ORDER + j]);
        }
    memcpy(A, s->likeness, sizeof A);
    const double least = UNTOLD * A[0];
    int rich = least > 0 && !la_cholesky(ORDER, A);
    for (int i = 0; i < ORDER; i++)
        rich = rich && A[i * (ORDER + 1)] * A[i * (ORDER + 1)] > least;
    return rich;
}

/* An instant of the network. */
static void take(State *s, const double *now)
{
    int moves = s->heard > 0;
    const int place = (int)s->newest;
    for (int c = 0; c < CHANNELS; c++) {
        const double x = now[c] * SCALE[c];
        s->signals[c * 2 * TAPS + place] = s->signals[c * 2 * TAPS + place + TAPS] = x;
        s->sum[6 * CELLS + c] += x * x;
        moves |= c && x != 0;
    }
    s->newest = (place + 1) % TAPS;
    s->heard += moves;
    add_products(s);
    if (++s->filled < BLOCK)
        return;
    s->block = ((int)s->block + 1) % BLOCKS;
    double *row = s->energies + (int)s->block * SIZE;
    for (int i = 0; i < SIZE; i++)
        row[i] = s->sum[i] / BLOCK;
    memset(s->sum, 0, sizeof s->sum);
    s->filled = 0;
    const int rich = is_rich(s);
    s->beyond = UNHEARD;
    if (s->heard >= ENOUGH && row[SIZE - 1] > 0)
        answer(s);
    if (!rich)
        s->beyond = UNHEARD;
}

const char *network_tracker_step(NetworkTracker *tracker, double step, const double *inputs)
{
    State *s = &tracker->now;
    const double share = step / STEP;
    double now[CHANNELS];
    if (share > 1 + SAME_STEP)
        return TOO_LONG;
    s->phase = s->phase >= 0 ? s->phase + share : 1;
    if (s->phase >= 1 - SAME_STEP) {
        s->phase = s->phase > 1 + SAME_STEP ? s->phase - 1 : 0;
        for (int i = 0; i < CHANNELS; i++)
            now[i] = inputs[i] + s->phase / share * (s->before[i] - inputs[i]);
        take(s, now);
    }
    memcpy(s->before, inputs, sizeof s->before);
    return 0;
}

double network_tracker_ln_k(const NetworkTracker *tracker)
{
    return tracker->now.ln_k;
}

double network_tracker_error(const NetworkTracker *tracker)
{
    return tracker->now.error;
}

int network_tracker_valid(const NetworkTracker *tracker)
{
    const State *s = &tracker->now;
    const double k_b = exp(s->ln_k);
    return s->error < MOST_DOUBTED && s->beyond <= 0 && k_b > LEAST_K_B && k_b < MOST_K_B;
}

int network_tracker_size(void)
{
    return sizeof(State) / sizeof(double);
}

void network_tracker_save(const NetworkTracker *tracker, double *state)
{
    memcpy(state, &tracker->now, sizeof(State));
}

static int is_place(double x, int n)
{
    return x >= 0 && x < n && x == floor(x);
}

int network_tracker_restore(NetworkTracker *tracker, const double *state)
{
    State s;
    memcpy(&s, state, sizeof s);
    if (!is_place(s.newest, TAPS) || !is_place(s.block, BLOCKS) || !is_place(s.filled, BLOCK))
        return 1;
    tracker->now = s;
    return 0;
}
