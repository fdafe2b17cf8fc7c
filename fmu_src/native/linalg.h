/* Small dense linear algebra, row by row, without memory of its own. */
#ifndef RIGTWIN_LINALG_H
#define RIGTWIN_LINALG_H

#include "names.h"

/* A = L L' in place, lower triangle. Returns 0, or 1 where A is not positive definite. */
int la_cholesky(int n, double *A);

/* PA = LU in place; rows (n) says where each row went. Returns 0, or 1 where A is singular. */
int la_lu(int n, double *A, int *rows);

/* X (n, k) with A X = B in place of B; LU and rows are those of la_lu. */
void la_lu_solve(int n, const double *LU, const int *rows, int k, double *B);

/* C (n, k) = A (n, m) B (m, k). */
void la_multiply(int n, int m, int k, const double *A, const double *B, double *C);

/* Values w (n) ascending, with the columns of V (m, n) that belong to them; equal ones keep their order. */
void la_sort_columns(int m, int n, double *w, double *V);

/* Eigenvalues w (n), ascending, and orthonormal eigenvectors, columns of V (n, n), of a symmetric A, which is lost. */
void la_symmetric_eigen(int n, double *A, double *w, double *V);

/* K phi = w M phi with phi' M phi = 1 for a positive definite M; a semidefinite K is one of a rotor that floats.
   w (n) ascending, Phi (n, n) by columns. work: 3 n^2. Returns 0, or 1 where M is not positive definite. */
int la_modes(int n, const double *K, const double *M, double *w, double *Phi, double *work);

/* E = exp(A) (n, n). work: 6 n^2, rows: n. */
void la_exponential(int n, const double *A, double *E, double *work, int *rows);

#endif
