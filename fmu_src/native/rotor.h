/* The rotor: what it consists of, and the matrices that follow. Mirrors rotor/design.py and rotor/model.py. */
#ifndef RIGTWIN_ROTOR_H
#define RIGTWIN_ROTOR_H

/* Free-free rotor, degrees of freedom node by node as (y, z, theta_y, theta_z); see rotor/structure.py. */
typedef struct {
    int n_mesh, n_nodes, n_disks, n_supports;
    const double *M, *K, *G, *K_tension;  /* (n, n), n = 4 n_mesh */
    const double *x;                      /* (n_mesh) */
    const int *stations;                  /* (n_nodes) mesh node of each rig node */
    const double *bending, *shear;        /* (n_mesh - 1, 2) E I and kappa G A in y and z */
    const double *diameter;               /* (n_mesh - 1) */
    const int *disk_node;                 /* (n_disks) */
    const double *disk_mass, *disk_thickness, *disk_lumped_diametral, *disk_lumped_polar;
    const int *support_node;              /* (n_supports) */
    const double *support_stiffness;      /* nan: k_b; inf: rigid */
    const double *support_tilt_stiffness; /* inf: rigid */
    const double *support_damping;
} Structure;

/* The rotor with its effects. What is not there is zero, unless said otherwise. */
typedef struct {
    double k_b, bearing_damping, shaft_damping_ratio, spin_speed;
    int rigid_support, excitation_node, excitation_plane; /* nodes from 1; plane 1 = y, 2 = z */
    double modulus_factor, hub_factor;                    /* 1: as drawn */
    double crack_position, crack_lost;
    double tension;
    double disk_mass_change, disk_inertia_factor, gyroscopic_factor;
    int mass_node[2]; /* 0: none */
    double mass[2];   /* attached, of an accelerometer */
    double mass_half_width[2];
    int sensor_node; /* whose accelerometer sits beside its node, 0: all */
    double sensor_offset;
    double ground_stiffness, ground_damping; /* where the exciter acts */
    double rigid_stiffness;                  /* inf: rigid */
    double tilt_stiffness;                   /* added to every bearing's own */
    int has_pedestal;
    double pedestal_stiffness, pedestal_mass, pedestal_damping;
    double block_compliance, block_mass; /* over the pedestal's; compliance 0: none */
    double asymmetry, offset, anisotropy, anisotropy_angle;
    int has_branch;
    double branch_strength, branch_time, branch_spread;
    int unbalance_node;
    double unbalance_moment, unbalance_phase;
    double cubic_stiffness;
    double hertz_preload; /* inf: none */
    double clearance_gap, clearance_preload;
    double friction_force, friction_stiffness, friction_spread;
    double bilinear_ratio; /* 1: none */
    int rub_node;
    double rub_stiffness, rub_gap;
} Design;

/* A force -pattern F(pattern q) of a law in laws.h, beyond the joint's linear stiffness. */
typedef struct {
    int law;
    double coefficients[3], offset; /* static displacement in y */
    double *y, *z;                  /* (n) patterns */
} LocalForce;

/* M q'' + (C + Omega G) q' + K q = f on the n degrees of freedom that are free to move. */
typedef struct {
    int n;
    double *M, *K, *C, *G, *K_shaft; /* (n, n) */
    int *free, *plane;               /* (n) */
    LocalForce *forces;
    int n_forces;
} System;

void design_nominal(Design *design);

/* Most degrees of freedom that a structure's system can have. */
int system_most(const Structure *structure);

/* Doubles, ints and local forces of memory that system_build needs. */
void system_memory(const Structure *structure, int *doubles, int *ints, int *forces);

/* Put the rotor on its supports; its forces have their memory already. Returns a sentence where that is impossible,
   or 0. */
const char *system_build(System *system, const Structure *structure, const Design *design, double *doubles, int *ints);

/* Pattern (n) of the deflection that a node's accelerometer sees. */
void system_sensor(const System *system, const Structure *structure, const Design *design, int node, int plane,
                   double *pattern);

/* Full index of a rig node's deflection. */
int structure_dof(const Structure *structure, int node, int plane);

#endif
