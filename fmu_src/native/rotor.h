/* The rotor: what it consists of, and the matrices that follow. Mirrors rotor/model/design.py and
   rotor/model/rotor_model.py. A rotor's ``Design``, its condition and its effects, is printed into design.h. */
#ifndef RIGTWIN_ROTOR_H
#define RIGTWIN_ROTOR_H

#include "names.h"
#include "design.h"

#define TWO_PI 6.283185307179586

/* Free-free rotor, degrees of freedom node by node as (y, z, theta_y, theta_z); see rotor/model/structure.py. */
typedef struct {
    int n_mesh, n_nodes, n_disks, n_supports, n_joints, n_rows;
    const double *M, *K, *G, *K_tension;  /* (n, n), n = 4 n_mesh */
    const double *x;                      /* (n_mesh) */
    const int *stations;                  /* (n_nodes) mesh node of each rig node */
    const double *bending_stiffness;      /* (n_mesh - 1, 2) E I in y and z */
    const double *shear_stiffness;        /* (n_mesh - 1, 2) kappa G A in y and z */
    const double *flexibility;            /* (n_mesh - 1, 2, 2, 2) of each element's cantilever in y and z */
    const double *diameter;               /* (n_mesh - 1) */
    const int *disk_node;                 /* (n_disks) */
    const double *disk_mass, *disk_thickness, *disk_lumped_diametral, *disk_lumped_polar;
    const int *support_node;              /* (n_supports) */
    const double *support_stiffness;      /* nan: k_b; inf: rigid */
    const double *support_tilt_stiffness; /* inf: rigid */
    const double *support_damping;
    const int *table_support;             /* (n_rows) support of each row of a table, from 0 */
    const double *table_spin_speed;       /* (n_rows) ascending for each support */
    const double *table_stiffness, *table_damping; /* (n_rows, 2, 2) in (y, z) */
    const int *joint_node;                /* (n_joints) mesh node on the left; the next one is on the right */
    const double *joint_stiffness, *joint_tilt_stiffness, *joint_damping, *joint_tilt_damping;
} Structure;

/* A force -pattern F(pattern q) of a law in laws.h, beyond the joint's linear stiffness. */
typedef struct {
    int law;
    double coefficients[3], offset; /* static displacement in y */
    double *y, *z;                  /* (n) patterns */
} LocalForce;

/* M q'' + (C + Omega G) q' + K q = f on the n degrees of freedom that are free to move. */
typedef struct {
    int n, follows_speed;            /* whether supports follow the spin speed: K need not be symmetric then */
    double *M, *K, *C, *G, *K_shaft; /* (n, n) */
    int *free, *plane;               /* (n) */
    LocalForce *forces;
    int n_forces;
} System;

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
