/* In place of tracker_network.c where no network knows the rig; method 1 is refused there, so that nothing calls these. */
#include "tracker_network.h"

NetworkTracker *network_tracker_new(void)
{
    return 0;
}

void network_tracker_free(NetworkTracker *tracker)
{
    (void)tracker;
}

int network_tracker_node(void)
{
    return 0;
}

void network_tracker_start(NetworkTracker *tracker, double ln_k, double error)
{
    (void)tracker, (void)ln_k, (void)error;
}

const char *network_tracker_step(NetworkTracker *tracker, double step, const double *inputs)
{
    (void)tracker, (void)step, (void)inputs;
    return 0;
}

double network_tracker_ln_k(const NetworkTracker *tracker)
{
    (void)tracker;
    return 0;
}

double network_tracker_error(const NetworkTracker *tracker)
{
    (void)tracker;
    return 0;
}

int network_tracker_valid(const NetworkTracker *tracker)
{
    (void)tracker;
    return 0;
}

int network_tracker_size(void)
{
    return 0;
}

void network_tracker_save(const NetworkTracker *tracker, double *state)
{
    (void)tracker, (void)state;
}

int network_tracker_restore(NetworkTracker *tracker, const double *state)
{
    (void)tracker, (void)state;
    return 1;
}
