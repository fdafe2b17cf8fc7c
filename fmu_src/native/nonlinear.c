#include "nonlinear.h"

#include "constants.h"
#include "laws.h"
#include "linalg.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PULLS 4       /* a cubic's coefficients */
#define TAYLOR 12     /* terms of a force's series: (2 pi / 16)^12 / 12! = 3e-14 */
#define LONG 4.0      /* rate times substep, beyond which the exponential would be squared anyway */
#define ROWS 16       /* of a block of W whose sums stay in registers */
#define MOST_LEVEL 60 /* the step is halved no more often than this */


/* Length of a column of W: whole blocks. */
static int whole_rows(int rows)
{
    return (rows + ROWS - 1) / ROWS * ROWS;
}

/* -- memory ------------------------------------------------------------------------------------------------------ */

static void place_instant(Instant *instant, Arena *arena, int J)
{
    instant->d = ARENA_DOUBLES(arena, J);
    instant->v = ARENA_DOUBLES(arena, J);
    instant->u = ARENA_DOUBLES(arena, 2 * J);
}

void nonlinear_place(Nonlinear *s, Arena *arena, int n, int J)
{
    const int all = n + TAYLOR * MOST_INPUTS + PULLS * J, in = n + TAYLOR * MOST_INPUTS + 2 * J;
    const int out = whole_rows(n + 2 * J);
    s->A = ARENA_DOUBLES(arena, n * n);
    s->G = ARENA_DOUBLES(arena, n * J);
    s->C = ARENA_DOUBLES(arena, J * n);
    s->joints = arena_take(arena, (size_t)J, sizeof *s->joints);
    s->parts = arena_take(arena, (size_t)n, sizeof *s->parts);
    s->group = ARENA_INTS(arena, n);
    s->joint_group = ARENA_INTS(arena, J);
    s->moving = ARENA_INTS(arena, n);
    s->divided = ARENA_INTS(arena, n);
    s->part_ints = ARENA_INTS(arena, n + 2 * J);
    s->part_doubles = ARENA_DOUBLES(arena, n * n + n * MOST_INPUTS + 3 * n * J + J);
    for (Substep *p = s->substeps; p < s->substeps + SUBSTEPS_KEPT; p++) {
        p->exponential = ARENA_DOUBLES(arena, all * all);
        p->W = ARENA_DOUBLES(arena, in * out);
        p->onset = ARENA_DOUBLES(arena, n * 2 * J);
        p->P = ARENA_DOUBLES(arena, J * 2 * J);
        p->Q = ARENA_DOUBLES(arena, J * 2 * J);
    }
    s->scratch = ARENA_DOUBLES(arena, 7 * all * all);
    s->rows = ARENA_INTS(arena, all);
    s->z = ARENA_DOUBLES(arena, in);
    s->after = ARENA_DOUBLES(arena, out);
    s->middle = ARENA_DOUBLES(arena, J);
    s->bounds = ARENA_DOUBLES(arena, J);
    s->notice = ARENA_DOUBLES(arena, J);
    s->pull_scale = ARENA_DOUBLES(arena, J);
    s->velocity_scale = ARENA_DOUBLES(arena, J);
    place_instant(&s->now, arena, J);
    place_instant(&s->next, arena, J);
}

/* -- laws as joints see them ------------------------------------------------------------------------------------- */

static double law_at(const LocalForce *force, double x, double *slope)
{
    double derivatives[3];
    const double pull = law_force(force->law, &x, force->coefficients, derivatives);
    *slope = derivatives[0];
    return pull;
}

/* Pull [N] and its slopes [N/m] by the own and by the partner's displacement, less the linear part; x_0 and g_0 are
   displacement and pull at the substep's start. A joint without a partner is its own: then the law acts in its plane
   alone. */
static double pull_of(const Joint *joint, int tied, double x, double x_0, double g_0, double partner, double *slope,
                      double *across)
{
    const LocalForce *force = joint->force;
    double derivatives[3], steep;
    *across = 0;
    if (LAWS[joint->law].memory) {
        const double variables[3] = {x, x_0, g_0};
        const double g = law_force(joint->law, variables, force->coefficients, derivatives);
        *slope = derivatives[0];
        return g;
    }
    if (!tied) {
        const double total = law_at(force, x + joint->offset, &steep);
        *slope = steep - joint->tangent;
        return total - joint->at_rest - joint->tangent * x;
    }
    const double u = x + joint->offset, w = partner + joint->offset_across, r = hypot(u, w);
    const double total = law_at(force, r, &steep);
    if (r < CENTRE) {
        *slope = steep - joint->tangent;
        return 0;
    }
    const double n = u / r, t = w / r, secant = total / r, bend = steep - secant;
    *slope = secant + bend * n * n - joint->tangent;
    *across = bend * n * t;
    return total * n - joint->at_rest - joint->tangent * x;
}

static double noise_of(const Joint *joint)
{
    double most = 0, slope, across;
    for (int k = 0; k < 16 && !LAWS[joint->law].memory; k++) {
        const double x = -STRAIGHT + k * (2 * STRAIGHT / 15);
        const double g = pull_of(joint, 0, x, 0, 0, 0, &slope, &across);
        most = fmax(most, fabs(g - slope * x));
    }
    return 4 * most;
}

static double tangent_of(const LocalForce *force, int plane)
{
    const Law *law = LAWS + force->law;
    double slope, still;
    if (law->memory)
        return 0;
    const double pull = law_at(force, force->offset, &slope);
    if (plane == 1)
        return slope;
    if (law->radial && force->offset != 0)
        return pull / force->offset;
    law_at(force, 0, &still);
    return still;
}

static void make_joint(Joint *joint, const LocalForce *force, int number, int plane)
{
    double slope;
    joint->force = force;
    joint->law = force->law;
    joint->plane = plane;
    joint->partner = LAWS[force->law].radial ? number + (plane == 1 ? 1 : -1) : number;
    joint->offset = plane == 1 ? force->offset : 0;
    joint->offset_across = plane == 1 ? 0 : force->offset;
    joint->tangent = tangent_of(force, plane);
    joint->at_rest = LAWS[force->law].memory ? 0 : law_at(force, joint->offset, &slope);
    joint->noise = noise_of(joint);
}

/* -- the rotor --------------------------------------------------------------------------------------------------- */

static double size_of(const double *values, int count)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += values[i] * values[i];
    return sqrt(sum);
}

static int acts_on(const Nonlinear *s, int i, int k)
{
    if (s->A[i * s->n + k] != 0 || s->A[k * s->n + i] != 0)
        return 1;
    for (int j = 0; j < s->J; j++)
        if ((s->G[i * s->J + j] != 0 && s->C[j * s->n + k] != 0) || (s->G[k * s->J + j] != 0 && s->C[j * s->n + i] != 0))
            return 1;
    return 0;
}

/* States that act on each other, by the linear rotor or by a joint, and which joints they move. */
static void find_groups(Nonlinear *s, int *queue)
{
    const int n = s->n;
    s->n_groups = 0;
    for (int i = 0; i < n; i++)
        s->group[i] = -1;
    for (int seed = 0; seed < n; seed++) {
        if (s->group[seed] >= 0)
            continue;
        int used = 0;
        queue[used++] = seed;
        s->group[seed] = s->n_groups;
        for (int next = 0; next < used; next++)
            for (int i = 0; i < n; i++)
                if (s->group[i] < 0 && acts_on(s, queue[next], i)) {
                    s->group[i] = s->n_groups;
                    queue[used++] = i;
                }
        s->n_groups++;
    }
    for (int j = 0; j < s->J; j++) {
        s->joint_group[j] = -1;
        for (int i = 0; i < n; i++)
            if (s->C[j * n + i] != 0)
                s->joint_group[j] = s->group[i];
    }
}

static double slowest(const States *states)
{
    for (int i = 0; i < states->m; i++)
        if (states->omega[i] > 0)
            return states->omega[i];
    return 0;
}

void nonlinear_build(Nonlinear *s, const System *system, const States *states, int n_inputs, const double *B,
                     double *work)
{
    const int n = s->n = states->n_states, J = s->J = 2 * system->n_forces;
    s->n_inputs = n_inputs, s->B = B;
    memcpy(s->A, states->A, (size_t)n * n * sizeof *s->A);
    for (int j = 0; j < J; j++) {
        const LocalForce *force = system->forces + j / 2;
        const double *pattern = j % 2 ? force->z : force->y;
        make_joint(s->joints + j, force, j, j % 2 + 1);
        states_displacement(states, pattern, s->C + j * n, work);
        states_input(states, pattern, work);
        for (int i = 0; i < n; i++)
            s->G[i * J + j] = -work[i];
    }
    for (int j = 0; j < J; j++)
        for (int i = 0; i < n; i++) {
            const double pull = s->G[i * J + j] * s->joints[j].tangent;
            for (int k = 0; pull != 0 && k < n; k++)
                s->A[i * n + k] += pull * s->C[j * n + k];
        }
    const double fastest = fmax(size_of(states->A, n * n), size_of(s->A, n * n));
    s->first = FIRST / fastest;
    s->shortest = FIRST * SHORTEST / fastest;
    s->fading = slowest(states) / (TWO_PI * PERIODS_KEPT);
    find_groups(s, s->moving);
    s->n_parts = 0;
    for (int g = 0; g < s->n_groups; g++)
        s->divided[g] = -1;
}

void nonlinear_start(Nonlinear *s, double *state, const double *carried)
{
    const int n = s->n, J = s->J;
    double *g = state + n, *rate = g + J, *pull_scale = rate + J, *velocity_scale = pull_scale + J;
    double *substep = velocity_scale + J, *d = s->scratch, *v = d + J, *x_rate = v + J, slope, across;
    la_multiply(J, n, 1, s->C, state, d);
    la_multiply(n, n, 1, s->A, state, x_rate);
    la_multiply(J, n, 1, s->C, x_rate, v);
    for (int j = 0; j < J; j++) {
        const Joint *joint = s->joints + j;
        const int other = joint->partner, tied = other != j;
        const double before = carried && LAWS[joint->law].memory ? carried[j] : 0;
        g[j] = pull_of(joint, tied, d[j], d[j], before, d[other], &slope, &across);
        const double ahead = d[j] + s->first * v[j]; /* where a law with memory goes from here */
        pull_of(joint, tied, ahead, d[j], g[j], d[other], &slope, &across);
        rate[j] = slope * v[j] + across * v[other];
        pull_scale[j] = fabs(g[j]);
        velocity_scale[j] = fabs(v[j]);
        substep[j] = 0;
    }
}

/* -- parts ------------------------------------------------------------------------------------------------------- */

static int reaches(const Nonlinear *s, int i, const Course *signal, const Tone *tones, int n_tones)
{
    const int pushes = signal && (signal->force != 0 || signal->rate != 0 || signal->curvature != 0);
    if (pushes && s->B[i * s->n_inputs] != 0)
        return 1;
    for (int k = 0; k < n_tones; k++)
        for (int c = 0; c < s->n_inputs; c++)
            if ((tones[k].re[c] != 0 || tones[k].im[c] != 0) && s->B[i * s->n_inputs + c] != 0)
                return 1;
    return 0;
}

/* Whether a radial law ties two groups: those of a force's y and z. */
static int ties(const Nonlinear *s, int j, int *y, int *z)
{
    *y = s->joint_group[j], *z = s->joint_group[j + 1];
    return LAWS[s->joints[j].law].radial && *y >= 0 && *z >= 0 && *y != *z;
}

/* The groups that move, or will. */
static void find_moving(Nonlinear *s, const double *state, const Course *signal, const Tone *tones, int n_tones)
{
    int y, z;
    memset(s->moving, 0, (size_t)s->n_groups * sizeof *s->moving);
    for (int i = 0; i < s->n; i++)
        if (!s->moving[s->group[i]])
            s->moving[s->group[i]] = state[i] != 0 || reaches(s, i, signal, tones, n_tones);
    for (int j = 0; j < s->J; j++)
        if (s->joint_group[j] >= 0 && state[s->n + j] != 0)
            s->moving[s->joint_group[j]] = 1;
    for (int j = 0; j < s->J; j += 2)
        if (ties(s, j, &y, &z) && s->moving[z] && s->joints[j].offset != 0)
            s->moving[y] = 1;
}

static void gather(double *to, const double *from, const int *rows, int n_rows, const int *columns, int n_columns, int wide)
{
    for (int i = 0; i < n_rows; i++)
        for (int k = 0; k < n_columns; k++)
            *to++ = from[rows[i] * wide + (columns ? columns[k] : k)];
}

static double column_sum(const double *matrix, int rows, int columns, int column)
{
    double sum = 0;
    for (int i = 0; i < rows; i++)
        sum += fabs(matrix[i * columns + column]);
    return sum;
}

static void make_part(Nonlinear *s, Part *part, const int *label, int number, int **ints, double **doubles)
{
    const int k = s->n_inputs;
    part->n = part->J = 0;
    part->places = *ints;
    for (int i = 0; i < s->n; i++)
        if (label[s->group[i]] == number)
            part->places[part->n++] = i;
    part->joints = part->places + part->n;
    for (int j = 0; j < s->J; j++)
        if (s->joint_group[j] >= 0 && label[s->joint_group[j]] == number)
            part->joints[part->J++] = j;
    const int n = part->n, J = part->J;
    part->partner = part->joints + J;
    for (int j = 0; j < J; j++) {
        part->partner[j] = j;
        for (int i = 0; i < J; i++)
            if (part->joints[i] == s->joints[part->joints[j]].partner)
                part->partner[j] = i;
    }
    *ints = part->partner + J;
    part->A = *doubles, part->B = part->A + n * n, part->G = part->B + n * k;
    part->C = part->G + n * J, part->V = part->C + J * n, part->round_off = part->V + J * n;
    *doubles = part->round_off + J;
    gather(part->A, s->A, part->places, n, part->places, n, s->n);
    gather(part->B, s->B, part->places, n, 0, k, k);
    gather(part->G, s->G, part->places, n, part->joints, J, s->J);
    gather(part->C, s->C, part->joints, J, part->places, n, s->n);
    la_multiply(J, n, n, part->C, part->A, part->V);
    part->rate = 0;
    for (int c = 0; c < n; c++)
        part->rate = fmax(part->rate, column_sum(part->A, n, n, c));
    for (int c = 0; c < J; c++)
        part->rate = fmax(part->rate, column_sum(part->G, n, J, c));
    for (int c = 0; c < k; c++)
        part->rate = fmax(part->rate, column_sum(part->B, n, k, c));
    for (int j = 0; j < J; j++)
        part->round_off[j] = ROUND_OFF * size_of(part->V + j * n, n);
}

/* The parts that move, or will; groups that a radial law ties make one part. */
static void divide(Nonlinear *s)
{
    int *label = s->divided, *ints = s->part_ints, y, z;
    double *doubles = s->part_doubles;
    for (int g = 0; g < s->n_groups; g++)
        label[g] = s->moving[g] ? g : -1;
    for (int j = 0; j < s->J; j += 2)
        if (ties(s, j, &y, &z) && s->moving[y] && s->moving[z])
            for (int g = 0, gone = label[z], kept = label[y]; g < s->n_groups; g++)
                if (label[g] == gone)
                    label[g] = kept;
    s->n_parts = 0;
    for (int g = 0; g < s->n_groups; g++) {
        int members = 0;
        for (int i = 0; i < s->n_groups; i++)
            members += label[i] == g;
        if (members)
            make_part(s, s->parts + s->n_parts++, label, g, &ints, &doubles);
    }
    for (Substep *p = s->substeps; p < s->substeps + SUBSTEPS_KEPT; p++)
        p->part = -1, p->last_used = 0;
}

static int is_divided(const Nonlinear *s)
{
    for (int g = 0; g < s->n_groups; g++)
        if (s->moving[g] != (s->divided[g] >= 0))
            return 0;
    return 1;
}

/* -- propagators of substeps ------------------------------------------------------------------------------------- */

/* x, then the coefficients of the joints' pulls power by power, then those of the forces. Each coefficient is the
   integral over s / tau of the one after it. */
static void exponentiate(Nonlinear *s, const Part *part, Substep *p)
{
    const int n = part->n, J = part->J, k = s->n_inputs, pulls = n, forces = n + PULLS * J, all = forces + TAYLOR * k;
    double *generator = s->scratch;
    memset(generator, 0, (size_t)all * all * sizeof *generator);
    for (int i = 0; i < n; i++) {
        double *row = generator + i * all;
        for (int c = 0; c < n; c++)
            row[c] = p->tau * part->A[i * n + c];
        for (int c = 0; c < J; c++)
            row[pulls + c] = p->tau * part->G[i * J + c];
        for (int c = 0; c < k; c++)
            row[forces + c] = p->tau * part->B[i * k + c];
    }
    for (int i = 0; i < (PULLS - 1) * J; i++)
        generator[(pulls + i) * all + pulls + J + i] = 1;
    for (int i = 0; i < (TAYLOR - 1) * k; i++)
        generator[(forces + i) * all + forces + k + i] = 1;
    la_exponential(all, generator, p->exponential, generator + all * all, s->rows);
}

/* From that of half the substep: its square, in coefficients of s / tau with twice the tau. */
static void square(Nonlinear *s, const Part *part, Substep *p, const Substep *half)
{
    const int n = part->n, J = part->J, k = s->n_inputs, forces = n + PULLS * J, all = forces + TAYLOR * k;
    int *power = s->rows;
    for (int i = 0; i < all; i++)
        power[i] = i < n ? 0 : i < forces ? (i - n) / J : (i - forces) / k;
    la_multiply(all, all, all, half->exponential, half->exponential, p->exponential);
    for (int i = 0; i < all; i++)
        for (int c = i < n ? n : i; c < all; c++)
            p->exponential[i * all + c] = ldexp(p->exponential[i * all + c], power[i] - power[c]);
}

/* What pulls with the cubic through g, g' at both ends make of x: start of those at the start, onset at the end. */
static void share_cubic(const Part *part, Substep *p, double *start, int all)
{
    const int n = part->n, J = part->J;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < J; j++) {
            const double *powers = p->exponential + i * all + n + j;
            const double one = powers[0], theta = powers[J], square = 2 * powers[2 * J], cube = 6 * powers[3 * J];
            start[i * 2 * J + j] = one - 3 * square + 2 * cube;
            start[i * 2 * J + J + j] = p->tau * (theta - 2 * square + cube);
            p->onset[i * 2 * J + j] = 3 * square - 2 * cube;
            p->onset[i * 2 * J + J + j] = p->tau * (cube - square);
        }
}

static void make_columns(Nonlinear *s, const Part *part, Substep *p)
{
    const int n = part->n, J = part->J, k = TAYLOR * s->n_inputs, forces = n + PULLS * J, all = forces + k;
    const int in = n + k + 2 * J, out = whole_rows(n + 2 * J);
    double *rows = s->scratch, *free = rows + n * in, *start = free + n * n;
    share_cubic(part, p, start, all);
    for (int i = 0; i < n; i++) {
        memcpy(free + i * n, p->exponential + i * all, (size_t)n * sizeof *free);
        memcpy(rows + i * in, p->exponential + i * all, (size_t)n * sizeof *rows);
        memcpy(rows + i * in + n, p->exponential + i * all + forces, (size_t)k * sizeof *rows);
    }
    double *carried = start + n * 2 * J, *seen = carried + n * 2 * J;
    la_multiply(n, n, 2 * J, free, p->onset, carried);
    for (int i = 0; i < n; i++)
        for (int c = 0; c < 2 * J; c++)
            rows[i * in + n + k + c] = carried[i * 2 * J + c] + start[i * 2 * J + c];
    la_multiply(J, n, in, part->C, rows, seen);
    la_multiply(J, n, in, part->V, rows, seen + J * in);
    for (int c = 0; c < in; c++) {
        for (int i = 0; i < n; i++)
            p->W[c * out + i] = rows[i * in + c];
        for (int j = 0; j < 2 * J; j++)
            p->W[c * out + n + j] = seen[j * in + c];
    }
}

static void make_responses(const Part *part, Substep *p)
{
    const int n = part->n, J = part->J;
    double coupling = 0;
    la_multiply(J, n, 2 * J, part->C, p->onset, p->P);
    la_multiply(J, n, 2 * J, part->V, p->onset, p->Q);
    p->tied = 0;
    for (int j = 0; j < J; j++) {
        double others = 0;
        for (int i = 0; i < J; i++)
            others += i == j ? 0 : fabs(p->P[j * 2 * J + i]);
        coupling = fmax(coupling, others / fmax(fabs(p->P[j * 2 * J + j]), 1e-300));
        p->tied |= part->partner[j] != j;
    }
    p->coupling = p->tied + coupling;
}

static Substep *recall(Nonlinear *s, int part, double tau)
{
    for (Substep *p = s->substeps; p < s->substeps + SUBSTEPS_KEPT; p++)
        if (p->part == part && p->tau == tau)
            return p;
    return 0;
}

/* The substep tau of a part; the one that was used longest ago makes room. A long one is always made of its halves and
   a short one never: what is remembered must not decide its last digits, or a saved state would not replay. */
static const Substep *substep(Nonlinear *s, int number, double tau)
{
    const Part *part = s->parts + number;
    Substep *found = recall(s, number, tau);
    if (!found) {
        const Substep *half = tau * part->rate > LONG ? substep(s, number, tau / 2) : 0;
        found = s->substeps;
        for (Substep *p = s->substeps; p < s->substeps + SUBSTEPS_KEPT; p++)
            if (p->last_used < found->last_used)
                found = p;
        found->part = number, found->tau = tau;
        if (half)
            square(s, part, found, half);
        else
            exponentiate(s, part, found);
        make_columns(s, part, found);
        make_responses(part, found);
    }
    found->last_used = ++s->clock;
    return found;
}

/* -- one substep ------------------------------------------------------------------------------------------------- */

/* The joint j at a substep's end by Newton's method, the others' pulls as they are: its d, v, g and g'. Returns whether
   it settles. */
static int settle(const Nonlinear *s, const Part *part, const Substep *p, int j, const double *free, double *slope)
{
    const int J = part->J, other = part->partner[j];
    const Joint *joint = s->joints + part->joints[j];
    const double *P = p->P + j * 2 * J, *Q = p->Q + j * 2 * J, allowed = NEWTON_SHARE * s->bounds[j];
    double *u = s->next.u, x_free = free[j], v_free = free[J + j], across;
    for (int i = 0; i < 2 * J; i++)
        if (i % J != j) {
            x_free += P[i] * u[i];
            v_free += Q[i] * u[i];
        }
    double x = x_free + P[j] * u[j] + P[J + j] * u[J + j];
    for (int k = 0; k < NEWTON_STEPS; k++) {
        const double g = pull_of(joint, other != j, x, s->now.d[j], s->now.u[j], s->next.d[other], slope, &across);
        const double rate = (*slope * (v_free + Q[j] * g) + across * s->next.v[other]) / (1 - *slope * Q[J + j]);
        const double excess = x - x_free - P[j] * g - P[J + j] * rate, miss = fabs(*slope * excess);
        if (miss <= allowed || miss <= NEWTON_RELATIVE * fabs(g)) {
            s->next.d[j] = x;
            s->next.v[j] = v_free + Q[j] * g + Q[J + j] * rate;
            u[j] = g;
            u[J + j] = rate;
            return 1;
        }
        x -= excess / (1 - *slope * (P[j] + P[J + j] * Q[j] * *slope));
    }
    return 0;
}

/* The joints at a substep's end, joint after joint, until none moves another. Returns whether Newton's method settles. */
static int balance(Nonlinear *s, const Part *part, const Substep *p, const double *free)
{
    const int J = part->J;
    double *u = s->next.u;
    memcpy(s->next.d, s->now.d, (size_t)J * sizeof(double));
    memcpy(s->next.v, s->now.v, (size_t)J * sizeof(double));
    for (int j = 0; j < J; j++) {
        u[j] = s->now.u[j] + p->tau * s->now.u[J + j];
        u[J + j] = s->now.u[J + j];
    }
    for (int sweep = 0; sweep < NEWTON_STEPS; sweep++) {
        double moved = 0, least = INFINITY, slope;
        s->next.stiffness = 0;
        for (int j = 0; j < J; j++) {
            const double g = u[j], rate = u[J + j];
            if (!settle(s, part, p, j, free, &slope))
                return 0;
            s->next.stiffness = fmax(s->next.stiffness, fabs(p->P[j * 2 * J + j] * slope));
            least = fmin(least, fmax(NEWTON_SHARE * s->bounds[j], NEWTON_RELATIVE * fabs(u[j])));
            if (j) /* what the first one does, the others have seen */
                moved = fmax(moved, fabs(u[j] - g) + p->tau * fabs(u[J + j] - rate));
        }
        if (moved * s->next.stiffness * p->coupling <= least && sweep >= p->tied)
            return 1;
    }
    return 0;
}

/* What a turning point within the substep may change in a pull: a path by way of the farthest one. */
static double turning(const Joint *joint, int tied, double tau, double x_0, double x_1, double g_0, double g_1, double v_0,
                      double v_1, double partner)
{
    const double swing = fabs(v_1 - v_0), reach = copysign(0.125 * tau * swing, v_0);
    double slope, across;
    if (fabs(v_0) >= swing && fabs(v_1) >= swing)
        return 0;
    const double turn = reach + (reach > 0 ? fmax(x_0, x_1) : fmin(x_0, x_1));
    const double g_turn = pull_of(joint, tied, turn, x_0, g_0, partner, &slope, &across);
    return fabs(pull_of(joint, tied, x_1, turn, g_turn, partner, &slope, &across) - g_1);
}

/* Errors of a substep over their bounds. */
static double severity(const Nonlinear *s, const Part *part, double tau)
{
    const Instant *a = &s->now, *b = &s->next;
    const int J = part->J;
    double worst = b->stiffness / STIFFNESS, slope, across;
    for (int j = 0; j < J; j++)
        s->middle[j] = 0.5 * (a->d[j] + b->d[j]) + 0.125 * tau * (a->v[j] - b->v[j]);
    for (int j = 0; j < J; j++) {
        const Joint *joint = s->joints + part->joints[j];
        const int other = part->partner[j], tied = other != j;
        if (!(s->bounds[j] > 0)) /* from rest: there is nothing to compare with yet */
            continue;
        const double g_0 = a->u[j], rise = b->u[j] - g_0, rise_0 = tau * a->u[J + j], rise_1 = tau * b->u[J + j];
        const double g = pull_of(joint, tied, s->middle[j], a->d[j], g_0, s->middle[other], &slope, &across);
        const double misfit = sqrt(fabs(g - g_0 - rise / 2 - (rise_0 - rise_1) / 8) / s->bounds[j]);
        const double error = BEND * (fabs(rise_0 - rise) + fabs(rise_1 - rise)) +
                             turning(joint, tied, tau, a->d[j], b->d[j], g_0, b->u[j], a->v[j], b->v[j], b->d[other]);
        const double scale = s->velocity_scale[j];
        const double kick =
            scale > 0 ? (b->v[j] - a->v[j]) / (VELOCITY_CHANGE * fmax(scale, fabs(b->v[j]))) : 0;
        if (!isfinite(misfit) || !isfinite(error) || !isfinite(kick))
            return INFINITY;
        worst = fmax(fmax(worst, misfit), fmax(error / s->bounds[j], kick * kick));
    }
    return worst;
}

/* -- one step of a part ------------------------------------------------------------------------------------------ */

typedef struct {
    const Part *part;
    int number, level, substeps; /* substeps since the scales faded */
    long all_substeps;
    long long place;
    double h, longest, elapsed;
    const Substep *p;
} Run;

/* Coefficients (TAYLOR, inputs) of the forces' series in s / tau about a time after the step's start. */
static void make_forces(const Nonlinear *s, double *series, const Course *signal, const Tone *tones, int n_tones,
                        double time, double tau)
{
    const int k = s->n_inputs;
    memset(series, 0, (size_t)TAYLOR * k * sizeof *series);
    series[0] = signal->force + time * (signal->rate + 0.5 * time * signal->curvature);
    series[k] = tau * (signal->rate + time * signal->curvature);
    series[2 * k] = tau * tau * signal->curvature;
    for (const Tone *tone = tones; tone < tones + n_tones; tone++) {
        const double phase = tone->start + tone->omega * time, cosine = cos(phase), sine = sin(phase);
        for (int c = 0; c < k; c++) {
            double im = tone->re[c] * sine + tone->im[c] * cosine, re = tone->re[c] * cosine - tone->im[c] * sine;
            for (int power = 0; power < TAYLOR; power++) { /* the next derivative: i omega times the phasor */
                const double now = im;
                series[power * k + c] += now;
                im = tone->omega * tau * re;
                re = -tone->omega * tau * now;
            }
        }
    }
}

static void set_bounds(Nonlinear *s, const Part *part)
{
    for (int j = 0; j < part->J; j++) {
        const double seen = fmax(FORCE_ERROR * s->pull_scale[j], s->notice[j] * s->velocity_scale[j]);
        s->bounds[j] = fmax(seen, s->joints[part->joints[j]].noise);
    }
}

static void use(Nonlinear *s, Run *run, const Substep *p)
{
    const int J = run->part->J;
    run->p = p;
    for (int j = 0; j < J; j++)
        s->notice[j] = UNNOTICED / fmax(2 * fabs(p->Q[j * 2 * J + j]), 1e-300);
    set_bounds(s, run->part);
}

/* Take up the joints' pulls and velocities. */
static void hold(Nonlinear *s, const Part *part)
{
    for (int j = 0; j < part->J; j++) {
        s->pull_scale[j] = fmax(s->pull_scale[j], fabs(s->now.u[j]));
        s->velocity_scale[j] = fmax(s->velocity_scale[j], fabs(s->now.v[j]));
    }
    set_bounds(s, part);
}

static void fade(Nonlinear *s, Run *run, const double *x)
{
    const Part *part = run->part;
    const double share = exp(-run->elapsed * s->fading), size = size_of(x, part->n);
    for (int j = 0; j < part->J; j++) {
        s->pull_scale[j] *= share;
        s->velocity_scale[j] = fmax(share * s->velocity_scale[j], size * part->round_off[j]);
    }
    hold(s, part);
    run->substeps = 0, run->elapsed = 0;
}

/* x (n) += sign times the share of u in it. */
static void add_onset(const Part *part, const Substep *p, const double *u, double sign, double *x)
{
    for (int i = 0; i < part->n; i++) {
        double sum = 0;
        for (int c = 0; c < 2 * part->J; c++)
            sum += p->onset[i * 2 * part->J + c] * u[c];
        x[i] += sign * sum;
    }
}

/* Go on with substeps of half (1) or twice (-1) the length. */
static void change(Nonlinear *s, Run *run, int levels)
{
    run->level += levels;
    run->place = levels > 0 ? 2 * run->place : run->place / 2;
    add_onset(run->part, run->p, s->now.u, 1, s->z);
    use(s, run, substep(s, run->number, ldexp(run->h, -run->level)));
    add_onset(run->part, run->p, s->now.u, -1, s->z);
}

static void propagate(Nonlinear *s, const Run *run)
{
    const int n = run->part->n, J = run->part->J, in = n + TAYLOR * s->n_inputs + 2 * J, out = whole_rows(n + 2 * J);
    for (int first = 0; first < out; first += ROWS) {
        const double *restrict column = run->p->W + first;
        double sums[ROWS] = {0};
        for (int c = 0; c < in; c++, column += out) {
            const double share = s->z[c];
            if (share == 0) /* forces that do not act */
                continue;
            for (int i = 0; i < ROWS; i++)
                sums[i] += column[i] * share;
        }
        memcpy(s->after + first, sums, sizeof sums);
    }
}

static void accept(Nonlinear *s, Run *run)
{
    const int n = run->part->n;
    const Instant kept = s->now;
    s->now = s->next;
    s->next = kept;
    memcpy(s->z, s->after, (size_t)n * sizeof *s->z);
    hold(s, run->part);
    run->place++;
    run->elapsed += run->p->tau;
    if (++run->substeps == SUBSTEPS_BETWEEN)
        fade(s, run, s->z);
}

static const char *no_balance(Nonlinear *s, const Run *run, const char *trouble)
{
    const int J = run->part->J;
    int worst = 0;
    double most = -1;
    for (int j = 0; j < J; j++) {
        const double moves = fabs(run->p->P[j * 2 * J + j] * s->now.u[J + j]);
        if (moves > most)
            most = moves, worst = j;
    }
    const Joint *joint = s->joints + run->part->joints[worst];
    snprintf(s->message, sizeof s->message,
             "the local force %s in %c %s at a displacement of %.3g m, even on a substep of %.1g s; check the effect's "
             "parameters and the force that drives the rotor",
             LAWS[joint->law].name, "yz"[joint->plane - 1], trouble, s->now.d[worst], run->p->tau);
    return s->message;
}

static double omega_heard(const Nonlinear *s, const Part *part, const Tone *tones, int n_tones)
{
    double fastest = 0;
    for (int i = 0; i < part->n; i++)
        for (int k = 0; k < n_tones; k++)
            if (reaches(s, part->places[i], 0, tones + k, 1))
                fastest = fmax(fastest, fabs(tones[k].omega));
    return fastest;
}

/* The first substep: as long as the last one, where the step's halves allow it. */
static void begin(Nonlinear *s, Run *run, const double *state, double fastest)
{
    const Part *part = run->part;
    const int J = part->J;
    double last = INFINITY;
    for (int j = 0; j < J; j++) {
        const double *row = state + s->n + part->joints[j];
        s->now.u[j] = row[0];
        s->now.u[J + j] = row[s->J];
        s->pull_scale[j] = row[2 * s->J];
        s->velocity_scale[j] = row[3 * s->J];
        last = fmin(last, row[4 * s->J]);
    }
    run->longest = TWO_PI / (fastest > 0 ? PER_PERIOD * fastest : 1e-300);
    double level = ceil(log2(run->h / run->longest)); /* of tones, which a part without joints hears as well */
    if (J)
        level = fmax(level, rint(log2(run->h / (last > 0 ? last : s->first))));
    run->level = (int)fmin(fmax(level, 0), MOST_LEVEL);
    run->place = run->substeps = 0, run->elapsed = 0;
    for (int i = 0; i < part->n; i++)
        s->z[i] = state[part->places[i]];
    la_multiply(J, part->n, 1, part->C, s->z, s->now.d);
    la_multiply(J, part->n, 1, part->V, s->z, s->now.v);
    use(s, run, substep(s, run->number, ldexp(run->h, -run->level)));
    add_onset(part, run->p, s->now.u, -1, s->z);
}

static void finish(Nonlinear *s, Run *run, double *state)
{
    const Part *part = run->part;
    add_onset(part, run->p, s->now.u, 1, s->z);
    fade(s, run, s->z);
    for (int i = 0; i < part->n; i++)
        state[part->places[i]] = s->z[i];
    for (int j = 0; j < part->J; j++) {
        double *row = state + s->n + part->joints[j];
        row[0] = s->now.u[j];
        row[s->J] = s->now.u[part->J + j];
        row[2 * s->J] = s->pull_scale[j];
        row[3 * s->J] = s->velocity_scale[j];
        row[4 * s->J] = run->p->tau;
    }
}

static const char *step_part(Nonlinear *s, int number, double *state, const Course *signal, const Tone *tones, int n_tones,
                             double h)
{
    const Part *part = s->parts + number;
    const int n = part->n, k = TAYLOR * s->n_inputs;
    Run run = {part, number, 0, 0, 0, 0, h, 0, 0, 0};
    begin(s, &run, state, omega_heard(s, part, tones, n_tones));
    while (run.place < 1LL << run.level) {
        make_forces(s, s->z + n, signal, tones, n_tones, (double)run.place * run.p->tau, run.p->tau);
        memcpy(s->z + n + k, s->now.u, 2 * (size_t)part->J * sizeof *s->z);
        propagate(s, &run);
        const int settled = balance(s, part, run.p, s->after + n);
        const double found = settled ? severity(s, part, run.p->tau) : INFINITY;
        if (!(found <= 1) && run.p->tau > s->shortest && run.level < MOST_LEVEL) {
            change(s, &run, 1);
        } else if (!settled) {
            return no_balance(s, &run, "finds no balance with the rotor");
        } else if (run.all_substeps++ == MOST_SUBSTEPS) {
            return no_balance(s, &run, "does not come to the end of the step");
        } else {
            accept(s, &run);
            if (found < EASY && run.level && !(run.place & 1) && 2 * run.p->tau <= run.longest)
                change(s, &run, -1);
        }
    }
    finish(s, &run, state);
    return 0;
}

const char *nonlinear_step(Nonlinear *s, double *state, const Course *signal, const Tone *tones, int n_tones, double h)
{
    find_moving(s, state, signal, tones, n_tones);
    if (!is_divided(s))
        divide(s);
    for (int number = 0; number < s->n_parts; number++) {
        const char *wrong = step_part(s, number, state, signal, tones, n_tones, h);
        if (wrong)
            return wrong;
    }
    return 0;
}
