#include "states.h"

#include "constants.h"
#include "linalg.h"

#include <math.h>
#include <string.h>

void states_memory(int n, int *doubles, int *ints)
{
    *doubles = 2 * n + 3 * n * n + 9 * n * n + 8 * n * n;
    *ints = 4 * n;
}

static int couples_planes(const System *system)
{
    const int n = system->n;
    const double *matrices[3] = {system->M, system->K, system->C};
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                if (system->plane[i] != system->plane[j] && matrices[k][i * n + j] != 0)
                    return 1;
    return 0;
}

/* Skew (n, n): the part of K that puts energy into whirl; returns whether there is any. */
static int circulatory(const System *system, double *skew)
{
    const int n = system->n;
    int any = 0;
    for (int i = 0; system->follows_speed && i < n; i++)
        for (int j = 0; j < n; j++) {
            skew[i * n + j] = (system->K[i * n + j] - system->K[j * n + i]) / 2;
            any = any || skew[i * n + j] != 0;
        }
    return any;
}

/* K of the degrees of freedom with mass, the massless ones following statically; slide on the way. */
static const char *condense(States *s, const System *system, double *K, double *work, int *rows)
{
    const int n = s->n, m = s->m, l = s->light;
    double *K_ll = work;
    for (int i = 0; i < l; i++) {
        for (int j = 0; j < l; j++)
            K_ll[i * l + j] = system->K[s->light_at[i] * n + s->light_at[j]];
        for (int j = 0; j < m; j++)
            s->slide[i * m + j] = -system->K[s->light_at[i] * n + s->heavy_at[j]];
    }
    if (l && la_lu(l, K_ll, rows))
        return "a massless joint is held by nothing";
    if (l)
        la_lu_solve(l, K_ll, rows, m, s->slide);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) {
            double sum = system->K[s->heavy_at[i] * n + s->heavy_at[j]];
            for (int k = 0; k < l; k++)
                sum += system->K[s->heavy_at[i] * n + s->light_at[k]] * s->slide[k * m + j];
            K[i * m + j] = sum;
        }
    return 0;
}

/* Strain energy of a column of Phi over the energies that add up to it, whatever their signs. */
static double strain_share(int n, const double *K, const double *Phi, int column)
{
    double energy = 0, size = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double part = Phi[i * n + column] * K[i * n + j] * Phi[j * n + column];
            energy += part;
            size += fabs(part);
        }
    return size > 0 ? energy / size : 0;
}

/* Modes of the degrees of freedom at some places; they become columns of shapes from ``first`` on. */
static const char *modes_of(States *s, const double *K, const double *M, const int *at, int count, int first, double *shapes,
                            double *work)
{
    const int m = s->m;
    double *k = work, *mass = k + count * count, *Phi = mass + count * count, *rest = Phi + count * count;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            k[i * count + j] = K[at[i] * m + at[j]];
            mass[i * count + j] = M[at[i] * m + at[j]];
        }
    if (la_modes(count, k, mass, s->omega + first, Phi, rest))
        return "the rotor's mass matrix is not positive";
    if (strain_share(count, k, Phi, 0) < -NO_STRAIN)
        return "the rotor buckles: reduce the axial compression, or the stiffness that is negative";
    for (int c = 0; c < count; c++) {
        const int strained = strain_share(count, k, Phi, c) > NO_STRAIN;
        s->omega[first + c] = strained ? sqrt(fmax(s->omega[first + c], 0)) : 0;
        for (int i = 0; i < count; i++)
            shapes[at[i] * m + first + c] = Phi[i * count + c];
    }
    return 0;
}

static const char *undamped_modes(States *s, const System *system, double *work, int *ints)
{
    const int n = s->n, m = s->m;
    double *K = work, *M = K + m * m, *rest = M + m * m;
    int *at = ints, first = 0;
    const int coupled = couples_planes(system);
    const char *wrong = condense(s, system, K, rest, at);
    if (wrong)
        return wrong;
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++)
            M[i * m + j] = system->M[s->heavy_at[i] * n + s->heavy_at[j]];
    for (int i = 0; system->follows_speed && i < m; i++)
        for (int j = 0; j < i; j++) /* the modes are those of the symmetric part */
            K[i * m + j] = K[j * m + i] = (K[i * m + j] + K[j * m + i]) / 2;
    memset(s->Phi, 0, (size_t)m * m * sizeof *s->Phi);
    for (int plane = 1; plane <= (coupled ? 1 : 2); plane++) {
        int count = 0;
        for (int i = 0; i < m; i++)
            if (coupled || system->plane[s->heavy_at[i]] == plane)
                at[count++] = i;
        wrong = count ? modes_of(s, K, M, at, count, first, s->Phi, rest) : 0;
        if (wrong)
            return wrong;
        first += count;
    }
    la_sort_columns(m, m, s->omega, s->Phi);
    memset(s->to_modal, 0, (size_t)m * m * sizeof *s->to_modal);
    for (int i = 0; i < m; i++)
        for (int c = 0; c < m; c++)
            for (int j = 0; j < m; j++)
                s->to_modal[c * m + j] += s->Phi[i * m + c] * M[i * m + j];
    return 0;
}

/* out (m, m) = Phi' X Phi, X (n, n) taken where there is mass; work: m^2. */
static void modal(const States *s, const double *X, double *out, double *work)
{
    const int n = s->n, m = s->m;
    memset(work, 0, (size_t)m * m * sizeof *work);
    memset(out, 0, (size_t)m * m * sizeof *out);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) {
            const double x = X[s->heavy_at[i] * n + s->heavy_at[j]];
            for (int c = 0; x != 0 && c < m; c++)
                work[i * m + c] += x * s->Phi[j * m + c];
        }
    for (int i = 0; i < m; i++)
        for (int a = 0; a < m; a++)
            for (int b = 0; b < m; b++)
                out[a * m + b] += s->Phi[i * m + a] * work[i * m + b];
}

/* Rows and columns of w: C_ww w' = -(C_wq + C_ww T) q' - K_ww w, and its force on q; see state_space.py. */
static const char *add_massless(States *s, const System *system, double spin, double *work, int *rows)
{
    const int n = s->n, m = s->m, l = s->light, N = s->n_states;
    double *C_ll = work, *relax = C_ll + l * l, *drag = relax + l * l, *back = drag + l * m;
    for (int i = 0; i < l; i++) {
        const int at = s->light_at[i] * n;
        for (int j = 0; j < l; j++) {
            C_ll[i * l + j] = system->C[at + s->light_at[j]] + spin * system->G[at + s->light_at[j]];
            relax[i * l + j] = system->K[at + s->light_at[j]];
        }
        for (int j = 0; j < m; j++)
            drag[i * m + j] = system->C[at + s->heavy_at[j]] + spin * system->G[at + s->heavy_at[j]];
    }
    if (la_lu(l, C_ll, rows))
        return "a massless joint without a dashpot has no rate";
    la_lu_solve(l, C_ll, rows, l, relax);
    la_lu_solve(l, C_ll, rows, m, drag);
    for (int i = 0; i < l; i++)
        for (int j = 0; j < l; j++)
            s->A[(2 * m + i) * N + 2 * m + j] = -relax[i * l + j];
    for (int i = 0; i < l; i++)
        for (int c = 0; c < m; c++) {
            double sum = 0;
            for (int j = 0; j < m; j++)
                sum += (drag[i * m + j] + s->slide[i * m + j]) * s->Phi[j * m + c];
            s->A[(2 * m + i) * N + m + c] = -sum;
        }
    /* s' = -drag q' - relax w acts back on q through C_hl, w itself through K_hl. */
    for (int i = 0; i < m; i++) {
        const int at = s->heavy_at[i] * n;
        memset(back, 0, (size_t)(m + l) * sizeof *back);
        for (int k = 0; k < l; k++) {
            const double c = system->C[at + s->light_at[k]] + spin * system->G[at + s->light_at[k]];
            for (int j = 0; j < m; j++)
                for (int b = 0; c != 0 && b < m; b++)
                    back[b] += c * drag[k * m + j] * s->Phi[j * m + b];
            for (int j = 0; j < l; j++)
                back[m + j] += c * relax[k * l + j];
            back[m + k] -= system->K[at + s->light_at[k]];
        }
        for (int a = 0; a < m; a++)
            for (int b = 0; b < m + l; b++)
                s->A[(m + a) * N + m + b] += s->Phi[i * m + a] * back[b];
    }
    return 0;
}

const char *states_build(States *s, const System *system, double zeta, double spin, double *doubles, int *ints)
{
    const int n = s->n = system->n;
    int *heavy = ints, *light = ints + n, m = 0, l = 0;
    for (int i = 0; i < n; i++)
        if (system->M[i * n + i] != 0)
            heavy[m++] = i;
        else
            light[l++] = i;
    const int N = 2 * m + l;
    s->m = m, s->light = l, s->n_states = N, s->heavy_at = heavy, s->light_at = light;
    s->omega = doubles, s->scale = s->omega + m;
    s->Phi = s->scale + m, s->to_modal = s->Phi + m * m;
    s->slide = s->to_modal + m * m, s->A = s->slide + l * m;
    double *work = s->A + N * N;
    const char *wrong = undamped_modes(s, system, work, ints + 2 * n);
    if (wrong)
        return wrong;
    double *shaft = work, *support = shaft + m * m, *gyroscopic = support + m * m, *rest = gyroscopic + m * m;
    modal(s, system->K_shaft, shaft, rest);
    modal(s, system->C, support, rest);
    modal(s, system->G, gyroscopic, rest);
    double *skew = rest, *whirling = skew + n * n;
    const int whirls = circulatory(system, skew);
    if (whirls)
        modal(s, skew, whirling, whirling + m * m);
    memset(s->A, 0, (size_t)N * N * sizeof *s->A);
    for (int i = 0; i < m; i++)
        s->scale[i] = s->omega[i] > 0 ? s->omega[i] : 1;
    for (int i = 0; i < m; i++) {
        const int strained = s->omega[i] > 0;
        s->A[i * N + m + i] = s->scale[i];
        s->A[(m + i) * N + i] = -s->omega[i];
        for (int j = 0; j < m; j++) {
            double damping = support[i * m + j] + spin * gyroscopic[i * m + j];
            if (strained && s->omega[j] > 0)
                damping += 2 * zeta * shaft[i * m + j] / (sqrt(s->omega[i]) * sqrt(s->omega[j]));
            s->A[(m + i) * N + m + j] = -damping;
            if (whirls)
                s->A[(m + i) * N + j] -= whirling[i * m + j] / s->scale[j];
        }
    }
    return l ? add_massless(s, system, spin, work, ints + 2 * n) : 0;
}

void states_input(const States *s, const double *pattern, double *column)
{
    const int m = s->m;
    memset(column, 0, (size_t)s->n_states * sizeof *column);
    for (int i = 0; i < m; i++)
        for (int c = 0; c < m; c++)
            column[m + c] += s->Phi[i * m + c] * pattern[s->heavy_at[i]];
}

void states_displacement(const States *s, const double *pattern, double *row, double *work)
{
    const int m = s->m, l = s->light;
    memset(row, 0, (size_t)s->n_states * sizeof *row);
    for (int i = 0; i < m; i++) {
        work[i] = pattern[s->heavy_at[i]];
        for (int k = 0; k < l; k++)
            work[i] += pattern[s->light_at[k]] * s->slide[k * m + i];
    }
    for (int i = 0; i < m; i++)
        for (int c = 0; c < m; c++)
            row[c] += work[i] * s->Phi[i * m + c];
    for (int c = 0; c < m; c++)
        row[c] /= s->scale[c];
    for (int k = 0; k < l; k++)
        row[2 * m + k] = pattern[s->light_at[k]];
}

void states_rate(const States *s, const double *row, double *rate)
{
    la_multiply(1, s->n_states, s->n_states, row, s->A, rate);
}

void states_of(const States *s, const double *q, const double *v, double *x)
{
    const int m = s->m;
    memset(x, 0, (size_t)s->n_states * sizeof *x);
    for (int c = 0; c < m; c++) {
        for (int i = 0; i < m; i++) {
            x[c] += s->to_modal[c * m + i] * q[s->heavy_at[i]];
            x[m + c] += s->to_modal[c * m + i] * v[s->heavy_at[i]];
        }
        x[c] *= s->scale[c];
    }
    for (int k = 0; k < s->light; k++) {
        x[2 * m + k] = q[s->light_at[k]];
        for (int i = 0; i < m; i++)
            x[2 * m + k] -= s->slide[k * m + i] * q[s->heavy_at[i]];
    }
}

void states_motion(const States *s, const double *x, double *q, double *v, double *work)
{
    const int m = s->m, N = s->n_states;
    double *rate = work;
    la_multiply(N, N, 1, s->A, x, rate);
    for (int pass = 0; pass < 2; pass++) {
        const double *from = pass ? rate : x;
        double *to = pass ? v : q;
        for (int i = 0; i < m; i++) {
            double sum = 0;
            for (int c = 0; c < m; c++)
                sum += s->Phi[i * m + c] / s->scale[c] * from[c];
            to[s->heavy_at[i]] = sum;
        }
        for (int k = 0; k < s->light; k++) {
            double sum = from[2 * m + k];
            for (int i = 0; i < m; i++)
                sum += s->slide[k * m + i] * to[s->heavy_at[i]];
            to[s->light_at[k]] = sum;
        }
    }
}
