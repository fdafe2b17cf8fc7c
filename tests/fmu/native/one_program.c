/* Both FMUs in one program, linked as they are: a rotor under a sine, then an estimator whose first shift grows. Prints
   what they give after each step.

   one_program ROTOR_ID ESTIMATOR_ID OUT AMPLITUDE FREQUENCY SHIFT STIFFNESS STEP STEPS: the GUIDs (tokens), the references
   of what is read and set, the step [s] and their number. FMI says which version: 2 or 3. */
#include <stdio.h>
#include <stdlib.h>

#define JOIN(prefix, name) prefix##name

#if FMI == 2
#include "fmi2FunctionTypes.h"
#define FUNCTION(fmu, name) fmi2##name##TYPE JOIN(fmu, fmi2##name)
#define DECLARE(fmu)                                                                                                  \
    FUNCTION(fmu, Instantiate);                                                                                       \
    FUNCTION(fmu, SetupExperiment);                                                                                   \
    FUNCTION(fmu, EnterInitializationMode);                                                                           \
    FUNCTION(fmu, ExitInitializationMode);                                                                            \
    FUNCTION(fmu, SetReal);                                                                                           \
    FUNCTION(fmu, GetReal);                                                                                           \
    FUNCTION(fmu, DoStep);                                                                                            \
    FUNCTION(fmu, Terminate);                                                                                         \
    FUNCTION(fmu, FreeInstance);
static const fmi2CallbackFunctions HOST = {0, calloc, free, 0, 0};
#define NEW(fmu, id) JOIN(fmu, fmi2Instantiate)("one", fmi2CoSimulation, id, "", &HOST, fmi2False, fmi2False)
#define START(fmu, c)                                                                                                 \
    (JOIN(fmu, fmi2SetupExperiment)(c, fmi2False, 0, 0, fmi2False, 0) || JOIN(fmu, fmi2EnterInitializationMode)(c) || \
     JOIN(fmu, fmi2ExitInitializationMode)(c))
#define SET(fmu, c, r, x) JOIN(fmu, fmi2SetReal)(c, &(r), 1, &(x))
#define GET(fmu, c, r, x) JOIN(fmu, fmi2GetReal)(c, &(r), 1, &(x))
#define STEP(fmu, c, t, h) JOIN(fmu, fmi2DoStep)(c, t, h, fmi2True)
#define END(fmu, c) (JOIN(fmu, fmi2Terminate)(c), JOIN(fmu, fmi2FreeInstance)(c))
typedef fmi2Component Slave;
typedef fmi2ValueReference Reference;
#else
#include "fmi3FunctionTypes.h"
#define FUNCTION(fmu, name) fmi3##name##TYPE JOIN(fmu, fmi3##name)
#define DECLARE(fmu)                                                                                                  \
    FUNCTION(fmu, InstantiateCoSimulation);                                                                           \
    FUNCTION(fmu, EnterInitializationMode);                                                                           \
    FUNCTION(fmu, ExitInitializationMode);                                                                            \
    FUNCTION(fmu, SetFloat64);                                                                                        \
    FUNCTION(fmu, GetFloat64);                                                                                        \
    FUNCTION(fmu, DoStep);                                                                                            \
    FUNCTION(fmu, Terminate);                                                                                         \
    FUNCTION(fmu, FreeInstance);
#define NEW(fmu, id) JOIN(fmu, fmi3InstantiateCoSimulation)("one", id, "", 0, 0, 0, 0, 0, 0, 0, 0, 0)
#define START(fmu, c)                                                                                                 \
    (JOIN(fmu, fmi3EnterInitializationMode)(c, 0, 0, 0, 0, 0) || JOIN(fmu, fmi3ExitInitializationMode)(c))
#define SET(fmu, c, r, x) JOIN(fmu, fmi3SetFloat64)(c, &(r), 1, &(x), 1)
#define GET(fmu, c, r, x) JOIN(fmu, fmi3GetFloat64)(c, &(r), 1, &(x), 1)
#define STEP(fmu, c, t, h) JOIN(fmu, fmi3DoStep)(c, t, h, 1, &event, &terminate, &early, &reached)
#define END(fmu, c) (JOIN(fmu, fmi3Terminate)(c), JOIN(fmu, fmi3FreeInstance)(c))
typedef fmi3Instance Slave;
typedef fmi3ValueReference Reference;
#endif

DECLARE(RotorRig_)
DECLARE(StiffnessEstimator_)

int main(int argc, char **argv)
{
    if (argc != 10)
        return 2;
    Reference r[5];
    for (int k = 0; k < 5; k++)
        r[k] = (Reference)strtoul(argv[3 + k], 0, 10);
    const double h = strtod(argv[8], 0), amplitude = 1, frequency = 60;
    const int steps = atoi(argv[9]);
#if FMI == 3
    fmi3Boolean event, terminate, early;
    double reached;
#endif
    Slave rotor = NEW(RotorRig_, argv[1]), estimator = NEW(StiffnessEstimator_, argv[2]);
    if (!rotor || !estimator || START(RotorRig_, rotor) || START(StiffnessEstimator_, estimator))
        return 3;
    if (SET(RotorRig_, rotor, r[1], amplitude) || SET(RotorRig_, rotor, r[2], frequency))
        return 4;
    for (int k = 0; k < steps; k++) {
        double acceleration, k_b, shift = 3 + 0.01 * k;
        if (SET(StiffnessEstimator_, estimator, r[3], shift) || STEP(RotorRig_, rotor, k * h, h) ||
            STEP(StiffnessEstimator_, estimator, k * h, h) || GET(RotorRig_, rotor, r[0], acceleration) ||
            GET(StiffnessEstimator_, estimator, r[4], k_b))
            return 5;
        printf("%.17g %.17g\n", acceleration, k_b);
    }
    END(RotorRig_, rotor);
    END(StiffnessEstimator_, estimator);
    return 0;
}
