#include "stepper.h"

#include "constants.h"
#include "linalg.h"

#include <math.h>
#include <string.h>

/* Largest matrix: twice as many real equations as complex ones; sines and cosines beside the states. */
#define WIDE(n) (2 * (n) + 2 * MOST_INPUTS + 1)

void stepper_memory(int n, int *doubles, int *ints)
{
    const int wide = WIDE(n);
    *doubles = REMEMBERED * (n * n + POWERS * n + 2 * n * MOST_INPUTS) + 8 * wide * wide + 8 * n;
    *ints = 2 * n + wide;
}

static int touches(const Stepper *s, int i, int j)
{
    return s->A[i * s->n + j] != 0 || s->A[j * s->n + i] != 0;
}

/* States in groups that do not act on each other. The last group takes what there is no room for. */
static void find_blocks(Stepper *s, int *group)
{
    const int n = s->n;
    int used = 0;
    for (int i = 0; i < n; i++)
        group[i] = 0;
    s->n_blocks = 0;
    for (int seed = 0; seed < n; seed++) {
        if (group[seed])
            continue;
        if (s->n_blocks < MOST_BLOCKS)
            s->first[s->n_blocks++] = used;
        int next = used;
        group[seed] = 1;
        s->places[used++] = seed;
        for (; next < used; next++)
            for (int i = 0; i < n; i++)
                if (!group[i] && touches(s, s->places[next], i)) {
                    group[i] = 1;
                    s->places[used++] = i;
                }
    }
    s->first[s->n_blocks] = n;
}

void stepper_build(Stepper *s, int n, int n_inputs, const double *A, const double *B, double *doubles, int *ints)
{
    s->n = n, s->n_inputs = n_inputs, s->A = A, s->B = B;
    memset(&s->steps, 0, sizeof s->steps);
    memset(&s->frequencies, 0, sizeof s->frequencies);
    for (int k = 0; k < REMEMBERED; k++) {
        s->propagators[k].free = doubles, s->propagators[k].pushed = doubles + n * n;
        s->steady[k].re = doubles + n * n + POWERS * n, s->steady[k].im = s->steady[k].re + n * MOST_INPUTS;
        doubles += n * n + POWERS * n + 2 * n * MOST_INPUTS;
    }
    s->work = doubles;
    s->places = ints, s->rows = ints + 2 * n;
    find_blocks(s, ints + n);
}

/* -- what is remembered ------------------------------------------------------------------------------------------ */

/* Place of what belongs to a key; known says whether it is there already. */
static int recall(Memory *memory, double key, int *known)
{
    int place = 0;
    *known = 0;
    for (int k = 0; k < REMEMBERED && !*known; k++) {
        *known = memory->last_used[k] && memory->key[k] == key;
        if (*known || memory->last_used[k] < memory->last_used[place])
            place = k;
    }
    memory->key[place] = key;
    memory->last_used[place] = ++memory->clock;
    return place;
}

static Propagator *propagator(Stepper *s, double h)
{
    int known;
    Propagator *p = s->propagators + recall(&s->steps, h, &known);
    if (!known)
        memset(p->made, 0, sizeof p->made);
    return p;
}

static Steady *steady(Stepper *s, double omega)
{
    int known;
    Steady *p = s->steady + recall(&s->frequencies, omega, &known);
    if (!known)
        memset(p->found, 0, sizeof p->found);
    return p;
}

/* Place of a block's own matrix in a propagator: squares of the blocks before it lie below the square of their sum. */
static double *free_of(const Stepper *s, const Propagator *p, int block)
{
    return p->free + s->first[block] * s->n;
}

static void propagate(Stepper *s, Propagator *p, int block, double h)
{
    const int first = s->first[block], m = s->first[block + 1] - first, wide = m + POWERS;
    const int *at = s->places + first;
    double *generator = s->work, *result = generator + wide * wide, *work = result + wide * wide;
    memset(generator, 0, (size_t)wide * wide * sizeof *generator);
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < m; j++)
            generator[i * wide + j] = h * s->A[at[i] * s->n + at[j]];
        generator[i * wide + m] = h * s->B[at[i] * s->n_inputs];
    }
    for (int p = 0; p < POWERS - 1; p++) /* every power is the integral of the one before */
        generator[(m + p) * wide + m + p + 1] = p + 1;
    la_exponential(wide, generator, result, work, s->rows);
    double *free = free_of(s, p, block);
    for (int i = 0; i < m; i++) {
        memcpy(free + i * m, result + i * wide, (size_t)m * sizeof *free);
        memcpy(p->pushed + (first + i) * POWERS, result + i * wide + m, POWERS * sizeof *free);
    }
    p->made[block] = 1;
}

/* (i omega - A)(X + i Y) = B as real equations: -A X - omega Y = B, omega X - A Y = 0. */
static void settle(Stepper *s, Steady *p, int block, double omega)
{
    const int first = s->first[block], m = s->first[block + 1] - first, wide = 2 * m, k = s->n_inputs;
    const int *at = s->places + first;
    double *matrix = s->work, *right = matrix + wide * wide, response = 0, load = 0;
    memset(matrix, 0, (size_t)wide * wide * sizeof *matrix);
    memset(right, 0, (size_t)wide * k * sizeof *right);
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < m; j++)
            matrix[i * wide + j] = matrix[(m + i) * wide + m + j] = -s->A[at[i] * s->n + at[j]];
        matrix[i * wide + m + i] = -omega;
        matrix[(m + i) * wide + i] = omega;
        for (int c = 0; c < k; c++) {
            right[i * k + c] = s->B[at[i] * k + c];
            load += right[i * k + c] * right[i * k + c];
        }
    }
    p->found[block] = -1;
    if (la_lu(wide, matrix, s->rows))
        return;
    la_lu_solve(wide, matrix, s->rows, k, right);
    for (int i = 0; i < wide * k; i++)
        response += right[i] * right[i];
    if (!(fabs(omega) * sqrt(response) < NO_STEADY_STATE * sqrt(load)))
        return;
    memcpy(p->re + first * k, right, (size_t)m * k * sizeof *right);
    memcpy(p->im + first * k, right + m * k, (size_t)m * k * sizeof *right);
    p->found[block] = 1;
}

/* -- a step ------------------------------------------------------------------------------------------------------ */

static int hears(const Stepper *s, int block, const Tone *tone)
{
    for (int i = s->first[block]; i < s->first[block + 1]; i++)
        for (int c = 0; c < s->n_inputs; c++)
            if ((tone->re[c] != 0 || tone->im[c] != 0) && s->B[s->places[i] * s->n_inputs + c] != 0)
                return 1;
    return 0;
}

/* What a tone alone makes of a block at rest, where it has no steady state: sines, then cosines, become states. */
static void add_driven_from_rest(Stepper *s, int block, const Tone *tone, double h, double *after)
{
    const int first = s->first[block], m = s->first[block + 1] - first, k = s->n_inputs, wide = m + 2 * k;
    const int *at = s->places + first;
    double *generator = s->work, *result = generator + wide * wide, *work = result + wide * wide;
    memset(generator, 0, (size_t)wide * wide * sizeof *generator);
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < m; j++)
            generator[i * wide + j] = h * s->A[at[i] * s->n + at[j]];
        for (int c = 0; c < k; c++)
            generator[i * wide + m + c] = h * s->B[at[i] * k + c];
    }
    for (int c = 0; c < k; c++) {
        generator[(m + c) * wide + m + k + c] = h * tone->omega;
        generator[(m + k + c) * wide + m + c] = -h * tone->omega;
    }
    la_exponential(wide, generator, result, work, s->rows);
    const double cosine = cos(tone->start), sine = sin(tone->start);
    for (int c = 0; c < k; c++) {
        const double now = tone->re[c] * sine + tone->im[c] * cosine; /* force = Im now, a quarter later: Re now */
        const double later = tone->re[c] * cosine - tone->im[c] * sine;
        for (int i = 0; i < m; i++)
            after[i] += result[i * wide + m + c] * now + result[i * wide + m + k + c] * later;
    }
}

/* Im[phasor e^{i phase}] of every state of a block, times a factor, added. */
static void add_steady(const Stepper *s, const Steady *p, int block, const Tone *tone, double phase, double factor, double *x)
{
    const int first = s->first[block], m = s->first[block + 1] - first, k = s->n_inputs;
    const double cosine = cos(phase), sine = sin(phase);
    for (int i = 0; i < m; i++) {
        double re = 0, im = 0;
        for (int c = 0; c < k; c++) {
            const double a = p->re[(first + i) * k + c], b = p->im[(first + i) * k + c];
            re += a * tone->re[c] - b * tone->im[c];
            im += a * tone->im[c] + b * tone->re[c];
        }
        x[i] += factor * (re * sine + im * cosine);
    }
}

static void step_block(Stepper *s, int block, double *x, const double *share, const Tone *tones, int n_tones, double h,
                       double *after)
{
    const int first = s->first[block], m = s->first[block + 1] - first;
    Propagator *p = propagator(s, h);
    if (!p->made[block])
        propagate(s, p, block, h);
    for (int i = 0; i < m; i++)
        for (int k = 0; k < POWERS; k++)
            after[i] = (k ? after[i] : 0) + p->pushed[(first + i) * POWERS + k] * share[k];
    for (const Tone *tone = tones; tone < tones + n_tones; tone++) {
        if (!hears(s, block, tone))
            continue;
        Steady *phasors = steady(s, tone->omega);
        if (!phasors->found[block])
            settle(s, phasors, block, tone->omega);
        if (phasors->found[block] < 0) {
            add_driven_from_rest(s, block, tone, h, after);
            continue;
        }
        add_steady(s, phasors, block, tone, tone->start, -1, x);
        add_steady(s, phasors, block, tone, tone->stop, 1, after);
    }
    const double *free = free_of(s, p, block);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++)
            after[i] += free[i * m + j] * x[j];
}

void stepper_step(Stepper *s, double *x, const Course *signal, const Tone *tones, int n_tones, double h)
{
    const int wide = WIDE(s->n);
    const double share[POWERS] = {signal->force, h * signal->rate, 0.5 * h * h * signal->curvature};
    const int pushes = share[0] != 0 || share[1] != 0 || share[2] != 0;
    double *before = s->work + 8 * wide * wide, *after = before + s->n;
    for (int block = 0; block < s->n_blocks; block++) {
        const int *at = s->places + s->first[block], m = s->first[block + 1] - s->first[block];
        int moves = 0;
        for (int i = 0; i < m; i++) {
            before[i] = x[at[i]];
            moves |= before[i] != 0 || (pushes && s->B[at[i] * s->n_inputs] != 0);
        }
        for (int k = 0; !moves && k < n_tones; k++)
            moves = hears(s, block, tones + k);
        if (!moves)
            continue;
        step_block(s, block, before, share, tones, n_tones, h, after);
        for (int i = 0; i < m; i++)
            x[at[i]] = after[i];
    }
}
