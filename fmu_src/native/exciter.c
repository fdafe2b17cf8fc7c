#include "exciter.h"

#include "constants.h"

void exciter_set(Exciter *e, double sample)
{
    e->sample = sample;
    if (e->last_step == 0)
        e->force = sample;
}

void exciter_give_rate(Exciter *e, double rate)
{
    e->given = 1, e->given_rate = rate;
}

Course exciter_course(const Exciter *e, double h)
{
    Course course = {e->sample, 0, 0};
    if (e->hold != 0)
        return course;
    if (e->last_step == 0 || h > LONGEST_GROWTH * e->last_step) {
        course.rate = e->given != 0 ? e->given_rate : 0;
        return course;
    }
    const double rate = e->given != 0 ? e->given_rate : (e->sample - e->previous) / e->last_step;
    const double ahead = e->sample + AHEAD * h * rate;
    course.force = e->force, course.rate = e->rate;
    course.curvature = (ahead - e->force - AHEAD * h * e->rate) / (h * h);
    return course;
}

void exciter_advance(Exciter *e, const Course *course, double h)
{
    e->force = course->force + h * (course->rate + 0.5 * h * course->curvature);
    e->rate = course->rate + h * course->curvature;
    e->previous = e->sample, e->last_step = h;
    e->given = e->given_rate = 0;
}
