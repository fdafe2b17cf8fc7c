/* Exact time stepping of the linear rotor under tones and the force of a signal. Mirrors rotor/stepper.py. */
#ifndef RIGTWIN_STEPPER_H
#define RIGTWIN_STEPPER_H

#include "names.h"
#include "exciter.h"

#define MOST_INPUTS 3   /* the exciter, an unbalance in y and in z */
#define MOST_BLOCKS 128 /* groups of states that do not act on each other */
#define POWERS 3        /* of time in the force of a signal */
#define REMEMBERED 8    /* propagators, and steady states */

/* Forces (inputs) Im[F e^{i phase}] at omega [rad/s], the phase going from start to stop during the step. */
typedef struct {
    double omega, start, stop, re[MOST_INPUTS], im[MOST_INPUTS];
} Tone;

/* Keys of what is remembered; the one that was used longest ago makes room. */
typedef struct {
    double key[REMEMBERED];
    long long last_used[REMEMBERED], clock; /* 0: never */
} Memory;

/* e^{hA} and int_0^h e^{(h-s)A} b (s/h)^p ds, (n, POWERS), of every block that has been asked for. */
typedef struct {
    int made[MOST_BLOCKS];
    double *free, *pushed;
} Propagator;

/* Phasors of the steady state under unit tones; found is -1 where a block has none. */
typedef struct {
    int found[MOST_BLOCKS];
    double *re, *im; /* (n_states, n_inputs) block by block */
} Steady;

typedef struct {
    int n, n_inputs, n_blocks;
    int first[MOST_BLOCKS + 1]; /* of each block in ``places`` */
    int *places;                /* (n) states block by block */
    const double *A, *B;        /* (n, n), (n, n_inputs) */
    Memory steps, frequencies;  /* h of the propagators, omega of the steady states */
    Propagator propagators[REMEMBERED];
    Steady steady[REMEMBERED];
    double *work;
    int *rows;
} Stepper;

/* Doubles and ints of memory for at most n states. */
void stepper_memory(int n, int *doubles, int *ints);

/* A (n, n) and B (n, n_inputs) stay where they are. */
void stepper_build(Stepper *stepper, int n, int n_inputs, const double *A, const double *B, double *doubles, int *ints);

/* x (n) after h seconds, in place. */
void stepper_step(Stepper *stepper, double *x, const Course *signal, const Tone *tones, int n_tones, double h);

#endif
