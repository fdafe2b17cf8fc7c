#include "reduced_rotor.h"

#include "linalg.h"

#include <math.h>
#include <string.h>

void reduced_accelerations(const ReducedRotor *R, const double *p, int node, double mass, int driven, double *rows,
                           Room *room)
{
    const int r = R->r, rr = r * r, row = 2 * r + 1;
    double *M = room->some, *K = M + rr, *C = K + rr, *b = C + rr;
    const double k = exp(p[STIFFNESS]), d = exp(p[BEARING_DAMPING]), zeta = exp(p[SHAFT_DAMPING]);
    const double heavier = expm1(p[DISK_MASS]), *at = R->nodes + node * r;
    const double place = fmin(fmax((p[STIFFNESS] - R->lowest_ln_k) / R->spacing, 0), R->n_stiffnesses - 1);
    const int left = (int)fmin(place, R->n_stiffnesses - 2);
    const double share = place - left, *C0 = R->C_shaft + left * rr, *C1 = C0 + rr;
    for (int i = 0; i < rr; i++) {
        M[i] = heavier * R->M_disks[i] + (i % (r + 1) == 0) + mass * at[i / r] * at[i % r];
        K[i] = R->K_fixed[i] + k * R->K_bearing[i];
        C[i] = d * R->C_bearing[i] + zeta * ((1 - share) * C0[i] + share * C1[i]);
    }
    memcpy(b, R->nodes + driven * r, (size_t)r * sizeof *b);
    la_lu(r, M, room->rows); /* a mass matrix is not singular */
    la_lu_solve(r, M, room->rows, r, K);
    la_lu_solve(r, M, room->rows, r, C);
    la_lu_solve(r, M, room->rows, 1, b);
    for (int i = 0; i < r; i++) {
        for (int j = 0; j < r; j++) {
            rows[i * row + j] = -K[i * r + j] / R->scale[j];
            rows[i * row + r + j] = -C[i * r + j];
        }
        rows[i * row + 2 * r] = b[i];
    }
}

void reduced_step(const ReducedRotor *R, const double *rows, double h, double *T, Room *room)
{
    const int r = R->r, n = 2 * r, row = n + 1, wide = n + FORCES;
    double *A = room->A;
    memset(A, 0, (size_t)(wide * wide) * sizeof *A);
    for (int i = 0; i < r; i++) {
        A[i * wide + r + i] = h * R->scale[i];
        for (int j = 0; j < row; j++)
            A[(r + i) * wide + j] = h * rows[i * row + j];
    }
    A[n * wide + n + 1] = A[(n + 1) * wide + n + 2] = 1;
    la_exponential(wide, A, room->E, room->some, room->rows);
    for (int i = 0; i < n; i++) {
        double *t = T + i * wide, *e = room->E + i * wide;
        memcpy(t, e, (size_t)n * sizeof *t);
        t[n] = e[n + 2] - e[n + 1] / 2;
        t[n + 1] = e[n] - 2 * e[n + 2];
        t[n + 2] = e[n + 2] + e[n + 1] / 2;
    }
}

void reduced_reading(const ReducedRotor *R, const double *rows, int n_read, const int *nodes, double *Y)
{
    const int r = R->r, row = 2 * r + 1;
    for (int q = 0; q < n_read; q++)
        for (int j = 0; j < row; j++) {
            double sum = 0;
            for (int i = 0; i < r; i++)
                sum += R->nodes[nodes[q] * r + i] * rows[i * row + j];
            Y[q * row + j] = sum;
        }
}
