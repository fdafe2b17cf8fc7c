"""Printed by ``python build_laws.py`` from ``force_laws.py``; do not edit.

Every function returns the force [N] and its derivatives: ``SCALAR``, for floats, by the law's variables; ``ARRAY``,
for the laws without memory and numpy arrays of equal shape, by the displacement and by the corner's rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy

def _spring_scalar(x, k):
    return k*x, k

def _cubic_scalar(x, k3):
    return k3*x**3, 3*k3*x**2

def _clearance_scalar(x, k, gap, corner):
    x0 = corner**2
    x1 = gap - x
    x2 = math.sqrt(x0 + x1**2)
    x3 = gap + x
    x4 = math.sqrt(x0 + x3**2)
    x5 = (1/2)*k
    return x5*(x2 - x4), -x5*(x1/x2 + x3/x4)

def _hertz_scalar(x, k, d0, corner):
    x0 = corner**2
    x1 = d0 + x
    x2 = math.sqrt(x0 + x1**2)
    x3 = x1 + x2
    x4 = d0 - x
    x5 = math.sqrt(x0 + x4**2)
    x6 = x4 + x5
    x7 = math.sqrt(2)/math.sqrt(d0)
    return -k*(x + (1/12)*x7*(-x3**(3/2) + x6**(3/2))), -k*((1/8)*x7*(-math.sqrt(x3)*(x1/x2 + 1) + math.sqrt(x6)*(-x4/x5 - 1)) + 1)

def _bilinear_scalar(x, k, ratio, corner):
    x0 = math.sqrt(corner**2 + x**2)
    x1 = (1/2)*k*(ratio - 1)
    return x1*(x + x0), x1*(x/x0 + 1)

def _contact_scalar(x, k, gap, corner):
    x0 = corner**2
    x1 = gap + x
    x2 = math.sqrt(x0 + x1**2)
    x3 = gap - x
    x4 = math.sqrt(x0 + x3**2)
    return k*(x - 1/2*x2 + (1/2)*x4), -k*((1/2)*x1/x2 + (1/2)*x3/x4 - 1)

def _jenkins_scalar(x, x_before, force_before, k, limit):
    x0 = force_before + k*(x - x_before)
    x1 = (limit < x0)
    x2 = (limit < -x0)
    x3 = x1 or x2
    return ((limit) if x1 else (-limit) if x2 else (x0)), ((0) if x3 else (k)), ((0) if x3 else (-k)), ((0) if x3 else (1))

def _spring_array(x, k):
    return k*x, k, 0

def _cubic_array(x, k3):
    return k3*x**3, 3*k3*x**2, 0

def _clearance_array(x, k, gap, corner):
    x0 = corner**2
    x1 = gap - x
    x2 = numpy.sqrt(x0 + x1**2)
    x3 = gap + x
    x4 = numpy.sqrt(x0 + x3**2)
    x5 = (1/2)*k
    x6 = x4**(-1.0)
    x7 = x2**(-1.0)
    return x5*(x2 - x4), -x5*(x1*x7 + x3*x6), -corner*x5*(x6 - x7)

def _hertz_array(x, k, d0, corner):
    x0 = corner**2
    x1 = d0 + x
    x2 = numpy.sqrt(x0 + x1**2)
    x3 = x1 + x2
    x4 = d0 - x
    x5 = numpy.sqrt(x0 + x4**2)
    x6 = x4 + x5
    x7 = numpy.sqrt(2)/numpy.sqrt(d0)
    x8 = numpy.sqrt(x3)
    x9 = x2**(-1.0)
    x10 = numpy.sqrt(x6)
    x11 = x5**(-1.0)
    x12 = (1/8)*x7
    return -k*(x + (1/12)*x7*(-x3**(3/2) + x6**(3/2))), -k*(x12*(x10*(-x11*x4 - 1) - x8*(x1*x9 + 1)) + 1), corner*k*x12*(-x10*x11 + x8*x9)

def _bilinear_array(x, k, ratio, corner):
    x0 = numpy.sqrt(corner**2 + x**2)
    x1 = (1/2)*k*(ratio - 1)
    x2 = x0**(-1.0)
    return x1*(x + x0), x1*(x*x2 + 1), corner*x1*x2

def _contact_array(x, k, gap, corner):
    x0 = corner**2
    x1 = gap + x
    x2 = numpy.sqrt(x0 + x1**2)
    x3 = gap - x
    x4 = numpy.sqrt(x0 + x3**2)
    x5 = x2**(-1.0)
    x6 = x4**(-1.0)
    return k*(x - 1/2*x2 + (1/2)*x4), -k*((1/2)*x1*x5 + (1/2)*x3*x6 - 1), -1/2*corner*k*(x5 - x6)

SCALAR: dict[str, Callable[..., tuple[Any, ...]]] = {
    "spring": _spring_scalar,
    "cubic": _cubic_scalar,
    "clearance": _clearance_scalar,
    "hertz": _hertz_scalar,
    "bilinear": _bilinear_scalar,
    "contact": _contact_scalar,
    "jenkins": _jenkins_scalar,
}

ARRAY: dict[str, Callable[..., tuple[Any, ...]]] = {
    "spring": _spring_array,
    "cubic": _cubic_array,
    "clearance": _clearance_array,
    "hertz": _hertz_array,
    "bilinear": _bilinear_array,
    "contact": _contact_array,
}
