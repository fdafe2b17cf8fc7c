#include "rotor.h"

#include "constants.h"
#include "laws.h"

#include <math.h>
#include <string.h>

#define DOF 4
#define MOST_ENTRIES 8             /* of a pattern: a point between two mesh nodes, and a base */
#define MOST_LAWS (4 + SEAT_PARTS) /* at a bearing */
#define JOINT_LAWS (2 + JOINT_PARTS) /* in a joint: a spring, parts that slip, a contact */

/* Where a plane's (w, slope) at both ends of an element are among its eight degrees of freedom, with their signs. */
static const int PLACES[2][4] = {{0, 3, 4, 7}, {1, 2, 5, 6}};
static const double SIGNS[2][4] = {{1, 1, 1, 1}, {1, -1, 1, -1}};

/* Entries of a vector over all degrees of freedom that are not zero. */
typedef struct {
    int count, place[MOST_ENTRIES];
    double weight[MOST_ENTRIES];
} Pattern;

typedef struct {
    const Structure *s;
    const Design *d;
    int n, size, used; /* of the structure, of all, taken so far */
    double *M, *K, *C, *G, *K_shaft;
    int *held;
    LocalForce *forces;
    int n_forces;
    double *patterns; /* (2 forces, size) */
} Assembly;

int structure_dof(const Structure *structure, int node, int plane)
{
    return DOF * structure->stations[node - 1] + plane - 1;
}

static int is_bearing(const Structure *s, int support)
{
    return isnan(s->support_stiffness[support]);
}

static int n_bearings(const Structure *s)
{
    int count = 0;
    for (int k = 0; k < s->n_supports; k++)
        count += is_bearing(s, k);
    return count;
}

/* -- where a point of the shaft is in the matrices ------------------------------------------------------------- */

static int element_at(const Structure *s, double x)
{
    int element = 0;
    while (element < s->n_mesh - 2 && s->x[element + 1] <= x)
        element++;
    return element;
}

static void put(Pattern *pattern, int place, double weight)
{
    pattern->place[pattern->count] = place;
    pattern->weight[pattern->count++] = weight;
}

static void shape_functions(double xi, double L, double phi, double deflection[4], double rotation[4])
{
    const double xi2 = xi * xi, xi3 = xi2 * xi;
    deflection[0] = 1 - 3 * xi2 + 2 * xi3 + phi * (1 - xi);
    deflection[1] = L * (xi - 2 * xi2 + xi3 + phi * (xi - xi2) / 2);
    deflection[2] = 3 * xi2 - 2 * xi3 + phi * xi;
    deflection[3] = L * (-xi2 + xi3 - phi * (xi - xi2) / 2);
    rotation[0] = 6 * (xi2 - xi) / L;
    rotation[1] = 1 - 4 * xi + 3 * xi2 + phi * (1 - xi);
    rotation[2] = 6 * (xi - xi2) / L;
    rotation[3] = 3 * xi2 - 2 * xi + phi * xi;
    for (int k = 0; k < 4; k++) {
        deflection[k] /= 1 + phi;
        rotation[k] /= 1 + phi;
    }
}

/* Deflection and rotation of the shaft at x in a plane; beyond its ends the shaft goes on straight and rigid. */
static void shaft_point(const Structure *s, double x, int plane, Pattern *w, Pattern *slope)
{
    int node = 0;
    double deflection[4], rotation[4];
    w->count = slope->count = 0;
    for (int k = 1; k < s->n_mesh; k++)
        if (fabs(s->x[k] - x) < fabs(s->x[node] - x))
            node = k;
    if (fabs(s->x[node] - x) < 1e-12) {
        put(w, DOF * node + plane - 1, 1);
        put(slope, DOF * node + PLACES[plane - 1][1], SIGNS[plane - 1][1]);
        return;
    }
    const int element = element_at(s, x);
    const double left = s->x[element], length = s->x[element + 1] - left;
    const double EI = s->bending_stiffness[2 * element + plane - 1], GA = s->shear_stiffness[2 * element + plane - 1];
    const double phi = 12 * EI / (GA * (length * length));
    const double inside = fmin(fmax(x, s->x[0]), s->x[s->n_mesh - 1]);
    shape_functions((inside - left) / length, length, phi, deflection, rotation);
    for (int k = 0; k < 4; k++) {
        const int place = DOF * element + PLACES[plane - 1][k];
        put(w, place, SIGNS[plane - 1][k] * (deflection[k] + (x - inside) * rotation[k]));
        put(slope, place, SIGNS[plane - 1][k] * rotation[k]);
    }
}

/* (2, 2) deflection and slope of a cantilever's end under a force and a moment there. */
static void cantilever(double L, double EI, double GA, double F[4])
{
    F[0] = L * L * L / (3 * EI) + L / GA;
    F[1] = F[2] = L * L / (2 * EI);
    F[3] = L / EI;
}

/* (4, 4) stiffness of an element from the flexibility of its cantilever. */
static void element_stiffness(const double F[4], double L, double K[16])
{
    const double relative[2][4] = {{-1, -L, 1, 0}, {0, -1, 0, 1}}; /* end 2 as seen from end 1 */
    const double det = F[0] * F[3] - F[1] * F[2];
    double solved[2][4];
    for (int k = 0; k < 4; k++) {
        solved[0][k] = (F[3] * relative[0][k] - F[1] * relative[1][k]) / det;
        solved[1][k] = (F[0] * relative[1][k] - F[2] * relative[0][k]) / det;
    }
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            K[4 * i + k] = relative[0][i] * solved[0][k] + relative[1][i] * solved[1][k];
}

/* How far a unit force at x bends and shears an element whose ends are held; zero at mesh nodes. */
static double local_flexibility(const Structure *s, double x, int plane)
{
    const int element = element_at(s, x);
    const double before = x - s->x[element], after = s->x[element + 1] - x;
    double F[4], left[16], right[16];
    if (fmin(before, after) < 1e-12)
        return 0;
    const double EI = s->bending_stiffness[2 * element + plane - 1], GA = s->shear_stiffness[2 * element + plane - 1];
    cantilever(before, EI, GA, F);
    element_stiffness(F, before, left);
    cantilever(after, EI, GA, F);
    element_stiffness(F, after, right);
    const double a = left[10] + right[0], b = left[11] + right[1], c = left[14] + right[4], d = left[15] + right[5];
    return d / (a * d - b * c);
}

/* -- the shaft -------------------------------------------------------------------------------------------------- */

/* (2, 2) flexibility, times E I, that hubs and cracks add to an element; returns whether there is any. */
static int added_flexibility(const Assembly *a, int element, double added[4])
{
    const Structure *s = a->s;
    const double start = s->x[element], end = s->x[element + 1];
    int any = 0;
    memset(added, 0, 4 * sizeof *added);
    for (int disk = 0; a->d->hub_stiffening.factor != 1 && disk < s->n_disks; disk++) {
        const double middle = s->x[s->disk_node[disk]], half = s->disk_thickness[disk] / 2;
        const double from = fmax(start, middle - half), to = fmin(end, middle + half);
        if (to - from <= 1e-12)
            continue;
        const double p = end - from, q = end - to, share = 1 / a->d->hub_stiffening.factor - 1;
        added[0] += share * ((p * p * p - q * q * q) / 3);
        added[1] += share * ((p * p - q * q) / 2);
        added[2] = added[1];
        added[3] += share * (p - q);
        any = 1;
    }
    if (a->d->open_crack.reduction != 0 && element == element_at(s, a->d->open_crack.position)) {
        const double lost = a->d->open_crack.reduction, lever = end - a->d->open_crack.position;
        const double compliance = CRACK_LENGTH * s->diameter[element] * lost / (1 - lost);
        added[0] += compliance * (lever * lever);
        added[1] += compliance * lever;
        added[2] = added[1];
        added[3] += compliance;
        any = 1;
    }
    return any;
}

static void weaken(Assembly *a, int element, const double added[4])
{
    const Structure *s = a->s;
    const double length = s->x[element + 1] - s->x[element];
    double F[4], before[16], after[16];
    for (int plane = 0; plane < 2; plane++) {
        const double EI = s->bending_stiffness[2 * element + plane], *sound = s->flexibility + 4 * (2 * element + plane);
        for (int k = 0; k < 4; k++)
            F[k] = sound[k] + added[k] / EI;
        element_stiffness(F, length, after);
        element_stiffness(sound, length, before);
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 4; k++) {
                const int row = DOF * element + PLACES[plane][i], column = DOF * element + PLACES[plane][k];
                const double change = after[4 * i + k] - before[4 * i + k];
                a->K_shaft[row * a->size + column] += SIGNS[plane][i] * change * SIGNS[plane][k];
            }
    }
}

static void add_shaft(Assembly *a)
{
    const Structure *s = a->s;
    const double tension = a->d->axial_load.force;
    double added[4];
    for (int i = 0; i < a->n; i++)
        for (int k = 0; k < a->n; k++) {
            a->K_shaft[i * a->size + k] = s->K[i * a->n + k];
            a->M[i * a->size + k] = s->M[i * a->n + k];
            a->G[i * a->size + k] = s->G[i * a->n + k];
        }
    for (int element = 0; element < s->n_mesh - 1; element++)
        if (added_flexibility(a, element, added))
            weaken(a, element, added);
    for (int i = 0; i < a->n; i++)
        for (int k = 0; k < a->n; k++) {
            const int at = i * a->size + k;
            a->K_shaft[at] *= a->d->shaft_modulus.factor;
            a->K[at] = a->K_shaft[at] + (tension != 0 ? tension * s->K_tension[i * a->n + k] : 0);
        }
}

static void add_at(double *matrix, int size, int place, double value)
{
    matrix[place * size + place] += value;
}

static void add_between(double *matrix, int size, int left, int right, double value)
{
    add_at(matrix, size, left, value);
    add_at(matrix, size, right, value);
    matrix[left * size + right] -= value;
    matrix[right * size + left] -= value;
}

/* Springs and dashpots between the two mesh nodes of each joint; what is rigid is tied at the end. */
static void add_joints(Assembly *a)
{
    const Structure *s = a->s;
    for (int k = 0; k < s->n_joints; k++)
        for (int plane = 0; plane < 2; plane++) {
            const int left = DOF * s->joint_node[k] + plane, right = left + DOF;
            if (!isinf(s->joint_stiffness[k])) {
                add_between(a->K, a->size, left, right, s->joint_stiffness[k]);
                add_between(a->C, a->size, left, right, s->joint_damping[k]);
            }
            if (!isinf(s->joint_tilt_stiffness[k])) {
                add_between(a->K, a->size, left + 2, right + 2, s->joint_tilt_stiffness[k]);
                add_between(a->C, a->size, left + 2, right + 2, s->joint_tilt_damping[k]);
            }
        }
}

/* The degree of freedom that a place moves with: on the right of a joint and in a rigid direction, the left one. */
static int tied_to(const Structure *s, int place)
{
    for (int k = 0; k < s->n_joints; k++)
        if (place / DOF == s->joint_node[k] + 1)
            return isinf(place % DOF < 2 ? s->joint_stiffness[k] : s->joint_tilt_stiffness[k]) ? place - DOF : place;
    return place;
}

/* The deflection at a distance along the shaft from a node. */
static void beside(const Structure *s, int node, double offset, int plane, Pattern *w)
{
    Pattern slope;
    shaft_point(s, s->x[s->stations[node - 1]] + offset, plane, w, &slope);
}

/* Add sum values_ij p_i p_j' over a joint's displacements in y and z. */
static void join(Assembly *a, double *matrix, const Pattern joint[2], const double values[4])
{
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            if (values[2 * i + j] == 0)
                continue;
            for (int p = 0; p < joint[i].count; p++)
                for (int q = 0; q < joint[j].count; q++)
                    matrix[joint[i].place[p] * a->size + joint[j].place[q]] +=
                        values[2 * i + j] * (joint[i].weight[p] * joint[j].weight[q]);
        }
}

/* The same value in y and z. */
static void alike(Assembly *a, double *matrix, const Pattern joint[2], double value)
{
    const double values[4] = {value, 0, 0, value};
    join(a, matrix, joint, values);
}

/* A mass at a node, or in halves on both sides of it; at node 0 there is none. */
static void add_mass(Assembly *a, int node, double mass, double half_width)
{
    for (int side = -1; node != 0 && side <= 1; side += 2) {
        Pattern w[2];
        for (int plane = 0; plane < 2; plane++)
            beside(a->s, node, side * half_width, plane + 1, &w[plane]);
        alike(a, a->M, w, mass / 2);
    }
}

/* Of a measured joint; its node 0 is the exciter's. */
static int joint_node(const Design *d)
{
    return d->measured_joint.node ? d->measured_joint.node : d->condition.excitation_node;
}

static void add_bodies(Assembly *a)
{
    const Structure *s = a->s;
    const Design *d = a->d;
    for (int disk = 0; disk < s->n_disks; disk++) {
        const int y = DOF * s->disk_node[disk], tilt = y + 2;
        const double polar = d->gyroscopic.factor * s->disk_lumped_polar[disk];
        for (int k = 0; k < 2; k++) {
            add_at(a->M, a->size, y + k, d->disk_mass.change * s->disk_mass[disk]);
            add_at(a->M, a->size, tilt + k, d->disk_inertia.factor * s->disk_lumped_diametral[disk]);
        }
        a->G[tilt * a->size + tilt + 1] += polar;
        a->G[(tilt + 1) * a->size + tilt] -= polar;
    }
    add_mass(a, d->attached_mass.node, d->attached_mass.mass, d->attached_mass.half_width);
    add_mass(a, d->sensor_mass.node, d->sensor_mass.mass, 0);
    add_mass(a, joint_node(d), d->measured_joint.mass, 0);
}

/* -- the supports ------------------------------------------------------------------------------------------------ */

static void hold(Assembly *a, int place, double stiffness)
{
    if (isinf(stiffness))
        a->held[place] = 1;
    else
        add_at(a->K, a->size, place, stiffness);
}

/* What a support that follows the spin speed adds there: a straight line between two rows of its table. */
static const char *add_table(Assembly *a, int support)
{
    const Structure *s = a->s;
    const double spin = a->d->condition.spin_speed, *speeds = s->table_spin_speed;
    int first = 0, last, row;
    while (first < s->n_rows && s->table_support[first] != support)
        first++;
    if (first == s->n_rows)
        return 0;
    for (last = first; last + 1 < s->n_rows && s->table_support[last + 1] == support; last++)
        ;
    if (!(spin >= speeds[first] - TABLE_END * speeds[first] && spin <= speeds[last] + TABLE_END * speeds[last]))
        return "spin_speed lies outside the table of a support: choose one inside, or extend the table in the rig file";
    for (row = first; row < last - 1 && speeds[row + 1] <= spin; row++)
        ;
    const double share = fmin(fmax((spin - speeds[row]) / (speeds[row + 1] - speeds[row]), 0), 1);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++) {
            const int at = (DOF * s->support_node[support] + i) * a->size + DOF * s->support_node[support] + k;
            const int here = 4 * row + 2 * i + k;
            a->K[at] += (1 - share) * s->table_stiffness[here] + share * s->table_stiffness[here + 4];
            a->C[at] += (1 - share) * s->table_damping[here] + share * s->table_damping[here + 4];
        }
    return 0;
}

/* Supports with a stiffness of their own, and bearings replaced by rigid supports. */
static const char *add_fixed_supports(Assembly *a)
{
    const Structure *s = a->s;
    for (int k = 0; k < s->n_supports; k++) {
        const char *wrong = add_table(a, k);
        if (wrong)
            return wrong;
        double stiffness = s->support_stiffness[k], damping = s->support_damping[k];
        if (is_bearing(s, k)) {
            if (!a->d->condition.rigid_support)
                continue;
            stiffness = a->d->compliant_rigid_support.stiffness;
            damping = 0; /* no bearing, no damper */
        }
        for (int plane = 0; plane < 2; plane++) {
            const int place = DOF * s->support_node[k] + plane;
            hold(a, place, stiffness);
            hold(a, place + 2, s->support_tilt_stiffness[k]);
            add_at(a->C, a->size, place, damping);
        }
    }
    return 0;
}

static Pattern difference(const Pattern *one, const Pattern *other)
{
    Pattern result = *one;
    for (int k = 0; k < other->count; k++)
        put(&result, other->place[k], -other->weight[k]);
    return result;
}

static void new_pair(Assembly *a, Pattern pair[2])
{
    for (int k = 0; k < 2; k++) {
        pair[k].count = 0;
        put(&pair[k], a->used++, 1);
    }
}

static void add_force(Assembly *a, const Pattern joint[2], int law, double c0, double c1, double c2, double offset)
{
    LocalForce *force = a->forces + a->n_forces;
    double *rows = a->patterns + 2 * a->n_forces++ * a->size;
    memset(rows, 0, 2 * (size_t)a->size * sizeof *rows);
    for (int plane = 0; plane < 2; plane++)
        for (int k = 0; k < joint[plane].count; k++)
            rows[plane * a->size + joint[plane].place[k]] = joint[plane].weight[k];
    force->law = law;
    force->coefficients[0] = c0, force->coefficients[1] = c1, force->coefficients[2] = c2;
    force->offset = offset;
    force->y = rows;
    force->z = rows + a->size;
}

/* The laws at a bearing's joint, whose linear stiffness is k. */
static void add_bearing_laws(Assembly *a, const Pattern joint[2], double k)
{
    const Design *d = a->d;
    if (d->bearing_cubic.stiffness != 0)
        add_force(a, joint, LAW_CUBIC, d->bearing_cubic.stiffness, 0, 0, 0);
    if (!isinf(d->bearing_hertz.preload))
        add_force(a, joint, LAW_HERTZ, k, d->bearing_hertz.preload, SHARP * d->bearing_hertz.preload, 0);
    if (d->bearing_clearance.gap != 0)
        add_force(a, joint, LAW_CLEARANCE, k, d->bearing_clearance.gap, SHARP * d->bearing_clearance.gap,
                  d->bearing_clearance.preload != 0 ? d->bearing_clearance.gap + d->bearing_clearance.preload / k : 0);
    if (d->bearing_friction.force != 0) {
        const int n = d->bearing_friction.spread != 0 ? SEAT_PARTS : 1;
        for (int part = 0; part < n; part++) {
            const double share = (1 + d->bearing_friction.spread * ((2.0 * part + 1) / n - 1)) / n;
            add_force(a, joint, LAW_JENKINS, d->bearing_friction.stiffness / n, share * d->bearing_friction.force, 0,
                      0);
        }
    }
    if (d->bilinear_support.ratio != 1)
        add_force(a, joint, LAW_BILINEAR, k, d->bilinear_support.ratio, SHARP_LENGTH, 0);
}

/* A law in place of the linear stiffness stands for all of it, the same in every direction. */
static const char *check_laws(const Design *d)
{
    const int hertz = !isinf(d->bearing_hertz.preload), clearance = d->bearing_clearance.gap != 0;
    if (hertz && clearance)
        return "bearing_hertz and bearing_clearance both take the place of k_b; switch one of them on";
    if ((hertz || clearance) && d->plane_anisotropy.anisotropy != 0)
        return "bearing_hertz and bearing_clearance take the place of k_b in every direction alike; they do not go with "
               "plane_anisotropy";
    return 0;
}

static int has_block(const Design *d)
{
    return d->pedestal_flexibility.block_compliance > GROUND_COMPLIANCE;
}

static void add_pedestal(Assembly *a, Pattern base[2])
{
    const Design *d = a->d;
    Pattern below[2], leg[2];
    base[0].count = base[1].count = below[0].count = below[1].count = 0;
    if (!d->pedestal_flexibility.enabled)
        return;
    new_pair(a, base);
    alike(a, a->M, base, d->pedestal_flexibility.mass);
    if (has_block(d)) {
        new_pair(a, below);
        alike(a, a->M, below, d->pedestal_flexibility.block_mass * d->pedestal_flexibility.mass);
        alike(a, a->K, below, d->pedestal_flexibility.stiffness / d->pedestal_flexibility.block_compliance);
    }
    for (int plane = 0; plane < 2; plane++)
        leg[plane] = difference(&base[plane], &below[plane]);
    alike(a, a->K, leg, d->pedestal_flexibility.stiffness);
    alike(a, a->C, leg, d->pedestal_flexibility.damping);
}

static int pedestals(const Design *d)
{
    return !d->pedestal_flexibility.enabled ? 0 : has_block(d) ? 2 : 1;
}

static void scaled(const double in[4], double factor, double out[4])
{
    for (int k = 0; k < 4; k++)
        out[k] = factor * in[k];
}

/* Share of a bearing's deflection that is its own, where the element below it yields; see rotor/model/rotor_model.py. */
static void own_share(const Assembly *a, double x, double stiffness[4], double shared_damping[4], double damping)
{
    const double soft = 1 / a->d->shaft_modulus.factor;
    const double f[2] = {soft * local_flexibility(a->s, x, 1), soft * local_flexibility(a->s, x, 2)};
    double yield[4], share[4], product[4];
    for (int k = 0; k < 4; k++)
        yield[k] = (k % 3 == 0) + stiffness[k] * f[k % 2];
    const double det = yield[0] * yield[3] - yield[1] * yield[2];
    share[0] = yield[3] / det;
    share[1] = -yield[1] / det;
    share[2] = -yield[2] / det;
    share[3] = yield[0] / det;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            product[2 * i + j] = share[2 * i] * stiffness[j] + share[2 * i + 1] * stiffness[2 + j];
            shared_damping[2 * i + j] =
                damping * (share[2 * i] * share[2 * j] + share[2 * i + 1] * share[2 * j + 1]);
        }
    memcpy(stiffness, product, sizeof product);
}

static int branches(const Design *d)
{
    return !d->viscoelastic_support.enabled ? 0 : d->viscoelastic_support.spread != 0 ? BRANCHES : 1;
}

static const char *add_bearing(Assembly *a, double x, int side, double tilt)
{
    const Design *d = a->d;
    Pattern shaft[2], slope[2], base[2], joint[2], end[2], spring[2], dashpot[2];
    const double at = x - side * d->bearing_offset.offset, half = d->plane_anisotropy.anisotropy / 2;
    const double c = cos(2 * d->plane_anisotropy.angle), s = sin(2 * d->plane_anisotropy.angle);
    const double k = d->condition.k_b * (1 - side * d->bearing_asymmetry.asymmetry);
    double stiffness[4] = {k * (1 + half * c), k * (half * s), k * (half * s), k * (1 - half * c)};
    double damping[4], relative[4];
    for (int plane = 0; plane < 2; plane++)
        shaft_point(a->s, at, plane + 1, &shaft[plane], &slope[plane]);
    tilt += d->bearing_tilt_stiffness.stiffness;
    for (int plane = 0; plane < 2; plane++) {
        if (isinf(tilt)) {
            if (slope[plane].count > 1)
                return "a bearing that holds the shaft's tilt rigidly can do so at a node only: leave bearing_offset out";
            a->held[slope[plane].place[0]] = 1;
        } else if (tilt != 0) {
            const Pattern one[2] = {slope[plane], {0, {0}, {0}}};
            const double value[4] = {tilt, 0, 0, 0};
            join(a, a->K, one, value);
        }
    }
    add_pedestal(a, base);
    for (int plane = 0; plane < 2; plane++)
        joint[plane] = difference(&shaft[plane], &base[plane]);
    own_share(a, at, stiffness, damping, d->bearing_damping.damping);
    join(a, a->K, joint, stiffness);
    join(a, a->C, joint, damping);
    for (int j = 1, n = branches(d); j <= n; j++) {
        const double share = fmin(j, n + 1 - j) / ((n + 1) / 2.0 * ((n + 1) / 2.0));
        const double strength = fmax(d->viscoelastic_support.strength, WEAKEST_BRANCH) * share;
        const double decades = d->viscoelastic_support.spread * (2 * j - n - 1) / fmax(n - 1, 1);
        new_pair(a, end);
        for (int plane = 0; plane < 2; plane++) {
            spring[plane] = difference(&shaft[plane], &end[plane]);
            dashpot[plane] = difference(&end[plane], &base[plane]);
        }
        scaled(stiffness, strength, relative);
        join(a, a->K, spring, relative);
        scaled(stiffness, strength * (d->viscoelastic_support.relaxation_time * pow(10, decades)), relative);
        join(a, a->C, dashpot, relative);
    }
    add_bearing_laws(a, joint, (stiffness[0] + stiffness[3]) / 2);
    return 0;
}

static const char *add_bearings(Assembly *a)
{
    const Structure *s = a->s;
    double least = INFINITY, most = -INFINITY;
    const char *wrong = check_laws(a->d);
    if (a->d->condition.rigid_support || wrong)
        return a->d->condition.rigid_support ? 0 : wrong;
    for (int k = 0; k < s->n_supports; k++)
        if (is_bearing(s, k)) {
            least = fmin(least, s->x[s->support_node[k]]);
            most = fmax(most, s->x[s->support_node[k]]);
        }
    for (int k = 0; k < s->n_supports; k++) {
        if (!is_bearing(s, k))
            continue;
        const double x = s->x[s->support_node[k]], beside = x - (least + most) / 2;
        wrong = add_bearing(a, x, (beside > 0) - (beside < 0), s->support_tilt_stiffness[k]);
        if (wrong)
            return wrong;
    }
    return 0;
}

static int has_branch(const Design *d)
{
    return d->measured_joint.branch_mass > NO_MASS;
}

static void add_measured_joint(Assembly *a)
{
    const Design *d = a->d;
    const double omega = TWO_PI * d->measured_joint.branch_frequency, mass = d->measured_joint.branch_mass;
    Pattern shaft[2], body[2], spring[2];
    if (!d->measured_joint.enabled)
        return;
    for (int plane = 0; plane < 2; plane++) {
        const int place = structure_dof(a->s, joint_node(d), plane + 1);
        add_at(a->K, a->size, place, d->measured_joint.stiffness);
        add_at(a->C, a->size, place, d->measured_joint.damping);
        shaft[plane].count = 0;
        put(&shaft[plane], place, 1);
    }
    if (!has_branch(d))
        return;
    new_pair(a, body);
    for (int plane = 0; plane < 2; plane++)
        spring[plane] = difference(&shaft[plane], &body[plane]);
    alike(a, a->M, body, mass);
    alike(a, a->K, spring, omega * omega * mass);
    alike(a, a->C, spring, 2 * d->measured_joint.branch_damping_ratio * omega * mass);
    alike(a, a->C, body, 2 * d->measured_joint.branch_ground_ratio * omega * mass);
}

static void add_at_nodes(Assembly *a)
{
    const Design *d = a->d;
    Pattern contact[2] = {{0, {0}, {0}}, {0, {0}, {0}}};
    const int drive = structure_dof(a->s, d->condition.excitation_node, d->condition.excitation_plane);
    add_at(a->K, a->size, drive, d->exciter_suspension.stiffness);
    add_at(a->C, a->size, drive, d->exciter_suspension.damping);
    add_measured_joint(a);
    if (d->rub.stiffness == 0)
        return;
    for (int plane = 0; plane < 2; plane++)
        put(&contact[plane], structure_dof(a->s, d->rub.node, plane + 1), 1);
    add_force(a, contact, LAW_CONTACT, d->rub.stiffness, d->rub.gap, SHARP * d->rub.gap, 0);
}

/* The laws of the angle between the two sections of a joint, whose stiffness against it is k. */
static void add_joint_laws(Assembly *a, int joint, double k)
{
    const Design *d = a->d;
    const int left = DOF * a->s->joint_node[joint];
    Pattern angle[2] = {{0, {0}, {0}}, {0, {0}, {0}}};
    for (int plane = 0; plane < 2; plane++) {
        const int place = left + PLACES[plane][1];
        put(&angle[plane], place + DOF, SIGNS[plane][1]);
        put(&angle[plane], place, -SIGNS[plane][1]);
    }
    if (!isinf(d->joint_microslip.angle)) {
        double above = 1;
        for (int part = 0; part < JOINT_PARTS; part++) {
            const double border = part + 1 < JOINT_PARTS ? pow(JOINT_RATIO, -0.5 - part) : 0;
            const double below = pow(border, d->joint_microslip.exponent), stiffness = (above - below) * k;
            add_force(a, angle, LAW_JENKINS, stiffness, stiffness * (d->joint_microslip.angle * pow(JOINT_RATIO, -part)), 0, 0);
            above = below;
        }
        add_force(a, angle, LAW_SPRING, -k, 0, 0, 0);
    }
    if (d->joint_microslip.contact != 0)
        add_force(a, angle, LAW_CONTACT, d->joint_microslip.contact * k, d->joint_microslip.gap,
                  SHARP * d->joint_microslip.gap, 0);
}

static void add_in_joints(Assembly *a)
{
    for (int joint = 0; joint < a->s->n_joints; joint++)
        if (!isinf(a->s->joint_tilt_stiffness[joint]))
            add_joint_laws(a, joint, a->s->joint_tilt_stiffness[joint]);
}

/* -- all together ------------------------------------------------------------------------------------------------ */

int system_most(const Structure *structure)
{
    /* of each bearing a pedestal, its block, branches; and the branch of a measured joint */
    return DOF * structure->n_mesh + 2 * (2 + BRANCHES) * n_bearings(structure) + 2;
}

void system_memory(const Structure *structure, int *doubles, int *ints, int *forces)
{
    const int size = system_most(structure);
    *forces = MOST_LAWS * n_bearings(structure) + JOINT_LAWS * structure->n_joints + 1; /* and a rub */
    *doubles = 5 * size * size + 2 * *forces * size;
    *ints = 3 * size;
}

/* Rows and columns that are free, moved together in place. */
static void compress(double *matrix, int rows, int size, const int *free, int n, int both)
{
    for (int i = 0; i < (both ? n : rows); i++)
        for (int k = 0; k < n; k++)
            matrix[i * n + k] = matrix[(both ? free[i] : i) * size + free[k]];
}

/* Add what acts on one degree of freedom to another that it moves with. */
static void tie(double *matrix, int rows, int size, int to, int from, int both)
{
    for (int i = 0; i < rows; i++)
        matrix[i * size + to] += matrix[i * size + from];
    for (int k = 0; both && k < size; k++)
        matrix[to * size + k] += matrix[from * size + k];
}

static void keep_free(System *system, Assembly *a)
{
    double *matrices[5] = {a->M, a->K, a->C, a->G, a->K_shaft};
    for (int place = 0; place < a->n; place++) {
        const int to = tied_to(a->s, place);
        if (to == place)
            continue;
        for (int k = 0; k < 5; k++)
            tie(matrices[k], a->size, a->size, to, place, 1);
        tie(a->patterns, 2 * a->n_forces, a->size, to, place, 0);
        a->held[place] = 1;
    }
    system->n = 0;
    for (int place = 0; place < a->size; place++)
        if (!a->held[place]) {
            const int along = place < a->n ? place % DOF : (place - a->n) % 2; /* supports' own are pairs (y, z) */
            system->plane[system->n] = along == 0 || along == 3 ? 1 : 2;
            system->free[system->n++] = place;
        }
    for (int k = 0; k < 5; k++)
        compress(matrices[k], a->size, a->size, system->free, system->n, 1);
    compress(a->patterns, 2 * a->n_forces, a->size, system->free, system->n, 0);
    for (int k = 0; k < a->n_forces; k++) {
        a->forces[k].y = a->patterns + 2 * k * system->n;
        a->forces[k].z = a->forces[k].y + system->n;
    }
}

const char *system_build(System *system, const Structure *structure, const Design *design, double *doubles, int *ints)
{
    const int bearings = design->condition.rigid_support ? 0 : n_bearings(structure), n = DOF * structure->n_mesh;
    const int size = n + 2 * (bearings * (pedestals(design) + branches(design)) + has_branch(design));
    Assembly a = {structure, design, n, size, n, 0, 0, 0, 0, 0, 0, system->forces, 0, 0};
    memset(doubles, 0, 5 * (size_t)size * size * sizeof *doubles);
    a.M = system->M = doubles;
    a.K = system->K = a.M + size * size;
    a.C = system->C = a.K + size * size;
    a.G = system->G = a.C + size * size;
    a.K_shaft = system->K_shaft = a.G + size * size;
    a.patterns = a.K_shaft + size * size;
    system->free = ints;
    system->plane = ints + size;
    a.held = ints + 2 * size;
    memset(a.held, 0, (size_t)size * sizeof *a.held);
    add_shaft(&a);
    add_joints(&a);
    add_bodies(&a);
    const char *wrong = add_fixed_supports(&a);
    if (!wrong)
        wrong = add_bearings(&a);
    if (wrong)
        return wrong;
    add_at_nodes(&a);
    add_in_joints(&a);
    keep_free(system, &a);
    system->n_forces = a.n_forces;
    system->follows_speed = structure->n_rows > 0;
    return 0;
}

void system_sensor(const System *system, const Structure *s, const Design *d, int node, int plane, double *pattern)
{
    const int displaced = d->sensor_position.node == 0 || d->sensor_position.node == node;
    Pattern w;
    beside(s, node, displaced ? d->sensor_position.offset : 0, plane, &w);
    for (int i = 0; i < system->n; i++) {
        pattern[i] = 0;
        for (int k = 0; k < w.count; k++)
            if (system->free[i] == tied_to(s, w.place[k]))
                pattern[i] = w.weight[k];
    }
}
