#include "linalg.h"

#include <float.h>
#include <math.h>
#include <string.h>

int la_cholesky(int n, double *A)
{
    for (int j = 0; j < n; j++) {
        double *row = A + j * n;
        double left = row[j];
        for (int k = 0; k < j; k++)
            left -= row[k] * row[k];
        if (!(left > 0))
            return 1;
        row[j] = sqrt(left);
        for (int i = j + 1; i < n; i++) {
            double sum = A[i * n + j];
            for (int k = 0; k < j; k++)
                sum -= A[i * n + k] * row[k];
            A[i * n + j] = sum / row[j];
        }
    }
    return 0;
}

int la_lu(int n, double *A, int *rows)
{
    for (int j = 0; j < n; j++) {
        int best = j;
        for (int i = j + 1; i < n; i++)
            if (fabs(A[i * n + j]) > fabs(A[best * n + j]))
                best = i;
        rows[j] = best;
        if (!(fabs(A[best * n + j]) > 0))
            return 1;
        if (best != j)
            for (int k = 0; k < n; k++) {
                double kept = A[j * n + k];
                A[j * n + k] = A[best * n + k];
                A[best * n + k] = kept;
            }
        for (int i = j + 1; i < n; i++) {
            double factor = A[i * n + j] /= A[j * n + j];
            if (factor != 0)
                for (int k = j + 1; k < n; k++)
                    A[i * n + k] -= factor * A[j * n + k];
        }
    }
    return 0;
}

void la_lu_solve(int n, const double *LU, const int *rows, int k, double *B)
{
    for (int j = 0; j < n; j++)
        if (rows[j] != j)
            for (int c = 0; c < k; c++) {
                double kept = B[j * k + c];
                B[j * k + c] = B[rows[j] * k + c];
                B[rows[j] * k + c] = kept;
            }
    for (int i = 1; i < n; i++)
        for (int j = 0; j < i; j++)
            for (int c = 0; c < k; c++)
                B[i * k + c] -= LU[i * n + j] * B[j * k + c];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            for (int c = 0; c < k; c++)
                B[i * k + c] -= LU[i * n + j] * B[j * k + c];
        for (int c = 0; c < k; c++)
            B[i * k + c] /= LU[i * n + i];
    }
}

void la_multiply(int n, int m, int k, const double *A, const double *B, double *C)
{
    memset(C, 0, (size_t)n * k * sizeof *C);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < m; j++) {
            double a = A[i * m + j];
            if (a != 0)
                for (int c = 0; c < k; c++)
                    C[i * k + c] += a * B[j * k + c];
        }
}

/* One rotation of Jacobi's method: A[p][q] becomes zero. */
static void rotate(int n, double *A, double *V, int p, int q)
{
    double apq = A[p * n + q], theta = (A[q * n + q] - A[p * n + p]) / (2 * apq);
    double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + hypot(theta, 1)), c = 1 / hypot(t, 1), s = t * c;
    double tau = s / (1 + c);
    A[p * n + p] -= t * apq;
    A[q * n + q] += t * apq;
    A[p * n + q] = A[q * n + p] = 0;
    for (int i = 0; i < n; i++) {
        double vp = V[i * n + p], vq = V[i * n + q];
        V[i * n + p] = vp - s * (vq + tau * vp);
        V[i * n + q] = vq + s * (vp - tau * vq);
        if (i == p || i == q)
            continue;
        double ap = A[i * n + p], aq = A[i * n + q];
        A[i * n + p] = A[p * n + i] = ap - s * (aq + tau * ap);
        A[i * n + q] = A[q * n + i] = aq + s * (ap - tau * aq);
    }
}

void la_sort_columns(int m, int n, double *w, double *V)
{
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && w[j] < w[j - 1]; j--) {
            double kept = w[j];
            w[j] = w[j - 1];
            w[j - 1] = kept;
            for (int k = 0; k < m; k++) {
                kept = V[k * n + j];
                V[k * n + j] = V[k * n + j - 1];
                V[k * n + j - 1] = kept;
            }
        }
}

/* Cyclic Jacobi: of a positive definite matrix it finds small eigenvalues as exactly as its entries say them
   (Demmel and Veselic 1992), which a reduction to tridiagonal form does not. */
void la_symmetric_eigen(int n, double *A, double *w, double *V)
{
    memset(V, 0, (size_t)n * n * sizeof *V);
    for (int i = 0; i < n; i++)
        V[i * n + i] = 1;
    for (int sweep = 0; sweep < 60; sweep++) {
        int rotated = 0;
        for (int p = 0; p < n - 1; p++)
            for (int q = p + 1; q < n; q++) {
                double size = sqrt(fabs(A[p * n + p])) * sqrt(fabs(A[q * n + q]));
                if (fabs(A[p * n + q]) > 0.5 * DBL_EPSILON * size && fabs(A[p * n + q]) > DBL_MIN) {
                    rotate(n, A, V, p, q);
                    rotated = 1;
                }
            }
        if (!rotated)
            break;
    }
    for (int i = 0; i < n; i++)
        w[i] = A[i * n + i];
    la_sort_columns(n, n, w, V);
}

/* With M = L L', the eigenvectors of L^-1 K L^-T are L' Phi. */
int la_modes(int n, const double *K, const double *M, double *w, double *Phi, double *work)
{
    double *L = work, *S = work + n * n, *V = work + 2 * n * n;
    memcpy(L, M, (size_t)n * n * sizeof *L);
    memcpy(S, K, (size_t)n * n * sizeof *S);
    if (la_cholesky(n, L))
        return 1;
    for (int side = 0; side < 2; side++) { /* S = L^-1 S, transposed; twice makes L^-1 K L^-T */
        for (int c = 0; c < n; c++)
            for (int i = 0; i < n; i++) {
                double sum = S[i * n + c];
                for (int k = 0; k < i; k++)
                    sum -= L[i * n + k] * S[k * n + c];
                S[i * n + c] = sum / L[i * n + i];
            }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++) {
                double kept = S[i * n + j];
                S[i * n + j] = S[j * n + i];
                S[j * n + i] = kept;
            }
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++)
            S[i * n + j] = S[j * n + i] = (S[i * n + j] + S[j * n + i]) / 2;
    la_symmetric_eigen(n, S, w, V);
    for (int c = 0; c < n; c++)
        for (int i = n - 1; i >= 0; i--) {
            double sum = V[i * n + c];
            for (int k = i + 1; k < n; k++)
                sum -= L[k * n + i] * Phi[k * n + c];
            Phi[i * n + c] = sum / L[i * n + i];
        }
    return 0;
}

static double norm_1(int n, const double *A)
{
    double largest = 0;
    for (int j = 0; j < n; j++) {
        double sum = 0;
        for (int i = 0; i < n; i++)
            sum += fabs(A[i * n + j]);
        if (!(sum <= largest))
            largest = sum;
    }
    return largest;
}

/* Sum = X6 (b[12] X6 + b[10] X4 + b[8] X2) + b[6] X6 + b[4] X4 + b[2] X2 + b[0] of powers X2, X4, X6; work: n^2. */
static void half_of_pade(int n, const double *b, const double *X2, const double *X4, const double *X6, double *sum,
                         double *work)
{
    for (int i = 0; i < n * n; i++)
        work[i] = b[12] * X6[i] + b[10] * X4[i] + b[8] * X2[i];
    la_multiply(n, n, n, X6, work, sum);
    for (int i = 0; i < n * n; i++)
        sum[i] += b[6] * X6[i] + b[4] * X4[i] + b[2] * X2[i] + (i % (n + 1) ? 0 : b[0]);
}

/* Scaling and squaring with the Pade approximant of degree 13 (Higham 2005). */
void la_exponential(int n, const double *A, double *E, double *work, int *rows)
{
    static const double b[] = {64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
                               129060195264000.0,   10559470521600.0,    670442572800.0,     33522128640.0,
                               1323241920.0,        40840800.0,          960960.0,           16380.0,
                               182.0,               1.0};
    const int nn = n * n;
    double *X = work, *X2 = X + nn, *X4 = X2 + nn, *X6 = X4 + nn, *U = X6 + nn, *W = U + nn, *V = E;
    int squarings = 0;
    double norm = norm_1(n, A);
    if (norm > 5.371920351148152 && isfinite(norm))
        squarings = (int)ceil(log2(norm / 5.371920351148152));
    for (int i = 0; i < nn; i++)
        X[i] = ldexp(A[i], -squarings);
    la_multiply(n, n, n, X, X, X2);
    la_multiply(n, n, n, X2, X2, X4);
    la_multiply(n, n, n, X4, X2, X6);
    half_of_pade(n, b + 1, X2, X4, X6, V, W);
    la_multiply(n, n, n, X, V, U);
    half_of_pade(n, b, X2, X4, X6, V, W);
    for (int i = 0; i < nn; i++) {
        W[i] = V[i] - U[i];
        E[i] = V[i] + U[i];
    }
    la_lu(n, W, rows); /* V - U is far from singular at this norm */
    la_lu_solve(n, W, rows, n, E);
    for (; squarings > 0; squarings--) {
        la_multiply(n, n, n, E, E, X);
        memcpy(E, X, (size_t)nn * sizeof *E);
    }
}
