#include "simulator.h"

#include "constants.h"
#include "exciter.h"
#include "laws.h"
#include "linalg.h"
#include "nonlinear.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define N_EXCITER (int)(sizeof(Exciter) / sizeof(double))
#define SCALARS (5 + N_EXCITER) /* of a snapshot, before the state */

/* Everything that follows from a design. Two of them: one is used while the other is built. */
typedef struct {
    Design design;
    System system;
    States states;
    Stepper stepper;
    Nonlinear nonlinear; /* steps instead where there are local forces */
    int n_inputs, n_joints, n_state; /* of the state: x, and what joints remember */
    double *B, *output, *feedthrough, *pull_out; /* (N, n_inputs), (n_out, N), (n_out, n_inputs), (n_out, n_joints) */
    double spin_re[MOST_INPUTS], spin_im[MOST_INPUTS]; /* forces that turn with the rotor */
    double *system_doubles, *states_doubles, *stepper_doubles;
    int *system_ints, *states_ints, *stepper_ints;
} Rotor;

struct Simulator {
    Structure structure;
    int n_out;
    double ticks, cycles, turns, amplitude, frequency;
    Exciter exciter;
    Rotor rotors[2];
    Rotor *rotor;
    double *x, *after, *q, *v, *carried, *work; /* x: the state */
    void *memory;
    char message[200];
};

/* -- memory ------------------------------------------------------------------------------------------------------ */

static void place_rotor(Rotor *r, Arena *arena, const Structure *structure)
{
    const int n = system_most(structure), N = 2 * n, n_out = 2 * structure->n_nodes;
    int doubles, ints, forces;
    system_memory(structure, &doubles, &ints, &forces);
    r->system_doubles = ARENA_DOUBLES(arena, doubles);
    r->system_ints = ARENA_INTS(arena, ints);
    r->system.forces = arena_take(arena, (size_t)forces, sizeof *r->system.forces);
    states_memory(n, &doubles, &ints);
    r->states_doubles = ARENA_DOUBLES(arena, doubles);
    r->states_ints = ARENA_INTS(arena, ints);
    stepper_memory(N, &doubles, &ints);
    r->stepper_doubles = ARENA_DOUBLES(arena, doubles);
    r->stepper_ints = ARENA_INTS(arena, ints);
    r->B = ARENA_DOUBLES(arena, N * MOST_INPUTS);
    r->output = ARENA_DOUBLES(arena, n_out * N);
    r->feedthrough = ARENA_DOUBLES(arena, n_out * MOST_INPUTS);
    r->pull_out = ARENA_DOUBLES(arena, n_out * 2 * forces);
    nonlinear_place(&r->nonlinear, arena, N, 2 * forces);
}

static void place(Simulator *s, Arena *arena)
{
    const int n = system_most(&s->structure), N = 2 * n;
    int doubles, ints, forces;
    system_memory(&s->structure, &doubles, &ints, &forces);
    place_rotor(s->rotors, arena, &s->structure);
    place_rotor(s->rotors + 1, arena, &s->structure);
    s->x = ARENA_DOUBLES(arena, N + JOINT_ROWS * 2 * forces);
    s->after = ARENA_DOUBLES(arena, N + JOINT_ROWS * 2 * forces);
    s->q = ARENA_DOUBLES(arena, n);
    s->v = ARENA_DOUBLES(arena, n);
    s->carried = ARENA_DOUBLES(arena, 2 * forces);
    s->work = ARENA_DOUBLES(arena, 4 * N);
}

Simulator *simulator_new(const Structure *structure)
{
    Simulator *s = calloc(1, sizeof *s);
    Arena arena = {0, 0};
    if (!s)
        return 0;
    s->structure = *structure;
    s->n_out = 2 * structure->n_nodes;
    place(s, &arena);
    arena.base = s->memory = calloc(arena.used, 1);
    if (!arena.base) {
        free(s);
        return 0;
    }
    arena.used = 0;
    place(s, &arena);
    return s;
}

void simulator_free(Simulator *s)
{
    if (!s)
        return;
    free(s->memory);
    free(s);
}

/* -- from a design to matrices ----------------------------------------------------------------------------------- */

/* Unit vector (n) of a rig node's deflection; zero where it is held. */
static void unit(const Simulator *s, const System *system, int node, int plane, double *vector)
{
    const int place = structure_dof(&s->structure, node, plane);
    for (int i = 0; i < system->n; i++)
        vector[i] = system->free[i] == place;
}

static void add_input(Simulator *s, Rotor *r, int node, int plane)
{
    double *pattern = s->work, *column = pattern + r->system.n;
    unit(s, &r->system, node, plane, pattern);
    states_input(&r->states, pattern, column);
    for (int i = 0; i < r->states.n_states; i++)
        r->B[i * MOST_INPUTS + r->n_inputs] = column[i];
    r->n_inputs++;
}

static void make_inputs(Simulator *s, Rotor *r)
{
    const Design *d = &r->design;
    const int N = r->states.n_states;
    r->n_inputs = 0;
    memset(r->spin_re, 0, sizeof r->spin_re);
    memset(r->spin_im, 0, sizeof r->spin_im);
    add_input(s, r, d->condition.excitation_node, d->condition.excitation_plane);
    if (d->unbalance.moment != 0) {
        const double pull = d->unbalance.moment * (d->condition.spin_speed * d->condition.spin_speed);
        const double c = pull * cos(d->unbalance.phase), sn = pull * sin(d->unbalance.phase);
        add_input(s, r, d->unbalance.node, 1);
        add_input(s, r, d->unbalance.node, 2);
        r->spin_re[1] = -sn, r->spin_im[1] = c; /* cosine along y */
        r->spin_re[2] = c, r->spin_im[2] = sn;  /* sine along z */
    }
    for (int i = 0; i < N; i++) /* rows as close as the inputs are many */
        memmove(r->B + i * r->n_inputs, r->B + i * MOST_INPUTS, (size_t)r->n_inputs * sizeof *r->B);
}

static void make_outputs(Simulator *s, Rotor *r)
{
    const int N = r->states.n_states, J = r->n_joints, n_nodes = s->structure.n_nodes;
    const double *A = J ? r->nonlinear.A : r->states.A;
    double *pattern = s->work, *row = pattern + r->system.n, *rate = row + N;
    for (int k = 0; k < s->n_out; k++) {
        system_sensor(&r->system, &s->structure, &r->design, k % n_nodes + 1, k / n_nodes + 1, pattern);
        states_displacement(&r->states, pattern, row, rate);
        states_rate(&r->states, row, rate);
        la_multiply(1, N, N, rate, A, r->output + k * N);
        la_multiply(1, N, J, rate, r->nonlinear.G, r->pull_out + k * J);
        for (int c = 0; c < r->n_inputs; c++) {
            double sum = 0;
            for (int i = 0; i < N; i++)
                sum += rate[i] * r->B[i * r->n_inputs + c];
            r->feedthrough[k * r->n_inputs + c] = sum;
        }
    }
}

static const char *build(Simulator *s, Rotor *r, const Design *design)
{
    memcpy(&r->design, design, sizeof r->design); /* with its gaps, which a comparison sees */
    const char *wrong = system_build(&r->system, &s->structure, design, r->system_doubles, r->system_ints);
    if (!wrong)
        wrong = states_build(&r->states, &r->system, design->shaft_damping.damping_ratio,
                             design->condition.spin_speed, r->states_doubles, r->states_ints);
    if (wrong)
        return wrong;
    make_inputs(s, r);
    r->n_joints = 2 * r->system.n_forces;
    r->n_state = r->states.n_states + JOINT_ROWS * r->n_joints;
    if (r->n_joints)
        nonlinear_build(&r->nonlinear, &r->system, &r->states, r->n_inputs, r->B, s->work);
    else
        stepper_build(&r->stepper, r->states.n_states, r->n_inputs, r->states.A, r->B, r->stepper_doubles,
                      r->stepper_ints);
    make_outputs(s, r);
    return 0;
}

static int same_freedom(const System *a, const System *b)
{
    return a->n == b->n && !memcmp(a->free, b->free, (size_t)a->n * sizeof *a->free);
}

static int at_rest(const Simulator *s)
{
    for (int i = 0; i < s->rotor->n_state; i++)
        if (s->x[i] != 0)
            return 0;
    return 1;
}

static int n_remembering(const Rotor *r)
{
    int count = 0;
    for (int j = 0; j < r->n_joints; j++)
        count += LAWS[r->nonlinear.joints[j].law].memory;
    return count;
}

/* The forces of the laws with memory go on in the next rotor where it has as many; otherwise they start from nothing. */
static void carry(Simulator *s, const Rotor *next)
{
    const double *g = s->x + s->rotor->states.n_states;
    int from = 0;
    memset(s->carried, 0, (size_t)next->n_joints * sizeof *s->carried);
    if (n_remembering(s->rotor) != n_remembering(next))
        return;
    for (int j = 0; j < next->n_joints; j++) {
        if (!LAWS[next->nonlinear.joints[j].law].memory)
            continue;
        while (!LAWS[s->rotor->nonlinear.joints[from].law].memory)
            from++;
        s->carried[j] = g[from++];
    }
}

const char *simulator_configure(Simulator *s, const Design *design)
{
    Rotor *next = s->rotor == s->rotors ? s->rotors + 1 : s->rotors;
    const char *wrong = build(s, next, design);
    if (wrong)
        return wrong;
    if (s->rotor && same_freedom(&s->rotor->system, &next->system)) {
        carry(s, next);
        states_motion(&s->rotor->states, s->x, s->q, s->v, s->work);
        states_of(&next->states, s->q, s->v, s->x);
        if (next->n_joints)
            nonlinear_start(&next->nonlinear, s->x, s->carried);
    } else if (s->rotor && !at_rest(s)) {
        return "this changes the degrees of freedom (rigid_support, or an effect with masses or states of its own): "
               "set it before the simulation starts";
    } else {
        memset(s->x, 0, (size_t)next->n_state * sizeof *s->x);
    }
    s->rotor = next;
    return 0;
}

/* -- time -------------------------------------------------------------------------------------------------------- */

void simulator_hold(Simulator *s, int hold)
{
    s->exciter.hold = hold;
}

void simulator_drive(Simulator *s, double force, double amplitude, double frequency)
{
    exciter_set(&s->exciter, force);
    s->amplitude = amplitude, s->frequency = frequency;
}

void simulator_give_rate(Simulator *s, double rate)
{
    exciter_give_rate(&s->exciter, rate);
}

/* A sentence with the numbers that it is about. */
static const char *refuse(Simulator *s, const char *format, double number, double other)
{
    snprintf(s->message, sizeof s->message, format, number, other);
    return s->message;
}

const char *simulator_start_at(Simulator *s, double time)
{
    if (!(fabs(time) <= LAST_TIME))
        return refuse(s, "the start time must lie within 1e+09 s of zero, got %.9g s", time, 0);
    s->ticks = rint(time * TICKS_PER_SECOND);
    return 0;
}

double simulator_time(const Simulator *s)
{
    return s->ticks / TICKS_PER_SECOND;
}

static double advanced(double periods, double frequency, double h)
{
    return fmod(periods + fmod(frequency * h, 1), 1);
}

static int make_tones(const Simulator *s, double cycles, double turns, Tone tones[2])
{
    const Rotor *r = s->rotor;
    int count = 0;
    if (s->amplitude != 0) {
        Tone sine = {TWO_PI * s->frequency, TWO_PI * s->cycles, TWO_PI * cycles, {s->amplitude}, {0}};
        tones[count++] = sine;
    }
    if (r->n_inputs > 1 && r->design.condition.spin_speed != 0) {
        Tone spin = {r->design.condition.spin_speed, TWO_PI * s->turns, TWO_PI * turns, {0}, {0}};
        memcpy(spin.re, r->spin_re, sizeof spin.re);
        memcpy(spin.im, r->spin_im, sizeof spin.im);
        tones[count++] = spin;
    }
    return count;
}

const char *simulator_advance(Simulator *s, double time, double step)
{
    if (!isfinite(time) || !isfinite(step))
        return refuse(s, "the communication step must be finite, got %.9g s at %.9g s", step, time);
    if (step <= 0)
        return refuse(s, "the communication step must be positive, got %.9g s", step, 0);
    if (fmax(fabs(time), fabs(time + step)) > LAST_TIME)
        return refuse(s, "a step to %.9g s leaves the clock's range of 1e+09 s", time + step, 0);
    if (fabs(time - simulator_time(s)) > SAME_TIME * step + 1e-9 * fmax(1, fabs(time)))
        return refuse(s, "a step from %.9g s was asked for, but the rotor stands at %.9g s", time, simulator_time(s));
    const double end = rint((time + step) * TICKS_PER_SECOND);
    if (end <= s->ticks)
        return refuse(s, "a communication step of %.9g s is below the clock's resolution", step, 0);
    const double h = (end - s->ticks) / TICKS_PER_SECOND;
    const double cycles = advanced(s->cycles, s->frequency, h);
    const double turns = advanced(s->turns, s->rotor->design.condition.spin_speed / TWO_PI, h);
    const Course course = exciter_course(&s->exciter, h);
    Tone tones[2];
    const int n_tones = make_tones(s, cycles, turns, tones);
    if (s->rotor->n_joints) {
        memcpy(s->after, s->x, (size_t)s->rotor->n_state * sizeof *s->x);
        const char *wrong = nonlinear_step(&s->rotor->nonlinear, s->after, &course, tones, n_tones, h);
        if (wrong)
            return wrong;
        memcpy(s->x, s->after, (size_t)s->rotor->n_state * sizeof *s->x);
    } else {
        stepper_step(&s->rotor->stepper, s->x, &course, tones, n_tones, h);
    }
    exciter_advance(&s->exciter, &course, h);
    s->cycles = cycles, s->turns = turns, s->ticks = end;
    return 0;
}

double simulator_force(const Simulator *s)
{
    return s->exciter.force + s->amplitude * sin(TWO_PI * s->cycles);
}

void simulator_accelerations(const Simulator *s, double *accelerations)
{
    const Rotor *r = s->rotor;
    const int N = r->states.n_states, k = r->n_inputs;
    double forces[MOST_INPUTS] = {simulator_force(s)};
    const double c = cos(TWO_PI * s->turns), sn = sin(TWO_PI * s->turns);
    for (int input = 1; input < k; input++)
        forces[input] = r->spin_re[input] * sn + r->spin_im[input] * c;
    for (int out = 0; out < s->n_out; out++) {
        double sum = 0;
        for (int i = 0; i < N; i++)
            sum += r->output[out * N + i] * s->x[i];
        for (int input = 0; input < k; input++)
            sum += r->feedthrough[out * k + input] * forces[input];
        for (int j = 0; j < r->n_joints; j++)
            sum += r->pull_out[out * r->n_joints + j] * s->x[N + j];
        accelerations[out] = sum;
    }
}

/* -- snapshots --------------------------------------------------------------------------------------------------- */

int simulator_snapshot_size(const Simulator *s)
{
    return SCALARS + s->rotor->n_state;
}

void simulator_save(const Simulator *s, double *snapshot)
{
    const double scalars[] = {s->ticks, s->cycles, s->turns, s->amplitude, s->frequency};
    memcpy(snapshot, scalars, sizeof scalars);
    memcpy(snapshot + SCALARS - N_EXCITER, &s->exciter, sizeof s->exciter);
    memcpy(snapshot + SCALARS, s->x, (size_t)s->rotor->n_state * sizeof *s->x);
}

const char *simulator_restore(Simulator *s, const Design *design, const double *snapshot, int size)
{
    Rotor *next = s->rotor;
    if (memcmp(design, &s->rotor->design, sizeof *design)) {
        next = s->rotor == s->rotors ? s->rotors + 1 : s->rotors;
        const char *wrong = build(s, next, design);
        if (wrong)
            return wrong;
    }
    if (size != SCALARS + next->n_state || !(fabs(snapshot[0]) <= LAST_TIME * TICKS_PER_SECOND))
        return "this is not a state of this rotor";
    s->rotor = next;
    s->ticks = snapshot[0], s->cycles = snapshot[1], s->turns = snapshot[2];
    s->amplitude = snapshot[3], s->frequency = snapshot[4];
    memcpy(&s->exciter, snapshot + SCALARS - N_EXCITER, sizeof s->exciter);
    memcpy(s->x, snapshot + SCALARS, (size_t)s->rotor->n_state * sizeof *s->x);
    return 0;
}
