"""An extended Kalman filter that knows the reduced rotor and follows its bearing stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from rigtwin.estimator.tracking.reduction import ReducedRotor
from rigtwin.rotor.model.arrays import FloatArray

KAPPA, MASS, BEARING, SHAFT, GAIN = range(5)
N_THETA = 5
_STEP = 1e-3


@dataclass
class Belief:
    start: FloatArray  # (5,) ln k_b, ln mass, ln c_b, ln zeta, ln gain
    std: FloatArray
    walk: FloatArray  # per root second


class Filter:
    def __init__(self, rotor: ReducedRotor, nodes, h: float, belief: Belief, noise: float, force_noise: float):
        self.rotor, self.h = rotor, h
        self.P_read = rotor.sensors[[n - 1 for n in nodes]]
        r = rotor.r
        self.r = r
        self.x = np.zeros(2 * r)
        self.theta = belief.start.copy()
        self.P = np.diag(np.concatenate([np.full(r, 1e-20), np.full(r, 1e-20), belief.std**2]))
        self.Q_theta = belief.walk**2 * h
        self.noise, self.force_noise = noise, force_noise
        self.limits = np.log([2e5, 1e9])
        self.f = self.f_before = 0.0
        self.at = None
        self.count = 0
        self.nis = 1.0
        self._move()

    def _matrices(self, theta):
        R, r, h = self.rotor, self.r, self.h
        Minv = np.linalg.inv(R.mass(theta[MASS]))
        A = np.zeros((2 * r + 3, 2 * r + 3))
        A[:r, r : 2 * r] = np.eye(r)
        A[r : 2 * r, :r] = -Minv @ R.stiffness(theta[KAPPA])
        A[r : 2 * r, r : 2 * r] = -Minv @ R.damping(theta[KAPPA], np.exp(theta[BEARING]), np.exp(theta[SHAFT]))
        A[r : 2 * r, 2 * r] = Minv @ R.force
        Y = self.P_read @ A[r : 2 * r, : 2 * r + 1]  # acceleration from x, f
        A = A * h
        A[2 * r, 2 * r + 1] = A[2 * r + 1, 2 * r + 2] = 1.0
        E = expm(A)[: 2 * r]
        value, slope, curve = E[:, 2 * r :].T  # responses to 1, s, s^2 / 2 with s in steps
        T = np.column_stack([E[:, : 2 * r], -slope / 2 + curve, value - 2 * curve, slope / 2 + curve])
        return T, Y

    def _move(self):
        self.at = self.theta.copy()
        self.count += 1
        self.T, self.Y = self._matrices(self.at)
        self.dT, self.dY = [], []
        for j in range(4):
            d = np.zeros(N_THETA)
            d[j] = _STEP
            up, down = self._matrices(self.at + d), self._matrices(self.at - d)
            self.dT.append((up[0] - down[0]) / (2 * _STEP))
            self.dY.append((up[1] - down[1]) / (2 * _STEP))
            if j == KAPPA:
                self.ddT = (up[0] + down[0] - 2 * self.T) / _STEP**2
                self.ddY = (up[1] + down[1] - 2 * self.Y) / _STEP**2

    def step(self, f: float, y: FloatArray):
        r, n = self.r, 2 * self.r
        d = self.theta - self.at
        if abs(d[KAPPA]) > 0.05 or abs(d[MASS]) > 0.003 or np.abs(d[2:4]).max() > 0.1:
            self._move()
            d = self.theta - self.at
        g = np.exp(self.theta[GAIN])
        u = np.concatenate([self.x, [g * self.f_before, g * self.f, g * f]])
        T = self.T + d[0] * self.dT[0] + d[1] * self.dT[1] + d[2] * self.dT[2] + d[3] * self.dT[3] + 0.5 * d[0] ** 2 * self.ddT
        J = np.stack([*(D @ u for D in self.dT), T[:, n:] @ u[n:]], 1)
        J[:, 0] += d[0] * (self.ddT @ u)
        self.x = T @ u
        W = np.hstack([T[:, :n], J])
        top = W @ self.P
        self.P[:n, :n] = top @ W.T
        self.P[:n, n:] = top[:, n:]
        self.P[n:, :n] = top[:, n:].T
        self.P[n + np.arange(5), n + np.arange(5)] += self.Q_theta
        G = T[:, n] + T[:, n + 1] + T[:, n + 2]
        self.P[:n, :n] += np.outer(G, G) * self.force_noise**2
        self.f_before, self.f = self.f, f
        # measurement
        Y = self.Y + d[0] * self.dY[0] + d[1] * self.dY[1] + d[2] * self.dY[2] + d[3] * self.dY[3] + 0.5 * d[0] ** 2 * self.ddY
        v = np.concatenate([self.x, [g * f]])
        H = np.hstack([Y[:, :n], np.stack([*(D @ v for D in self.dY), Y[:, n] * g * f], 1)])
        H[:, n] += d[0] * (self.ddY @ v)
        e = y - Y @ v
        nis = self.logdet = 0.0
        for j in range(len(y)):
            Ph = self.P @ H[j]
            s = H[j] @ Ph + self.noise**2
            K = Ph / s
            ej = e[j]
            nis += ej * ej / s
            self.logdet += np.log(s)
            self.x = self.x + K[:n] * ej
            self.theta = self.theta + K[n:] * ej
            self.P -= np.outer(K, Ph)
            self.P = 0.5 * (self.P + self.P.T)
            # later rows see the changed state
            for i in range(j + 1, len(y)):
                e[i] -= H[i] @ K * ej
        self.theta[KAPPA] = np.clip(self.theta[KAPPA], *self.limits)
        return nis / len(y), self.logdet


import copy


WALK = 1.5


class Bank:
    """Gaussian sum: one filter, and more after an alarm."""

    SPREAD = np.array([-1.2, -0.9, -0.6, -0.35, -0.15, 0.0, 0.15, 0.35, 0.6, 0.9, 1.2])

    def __init__(self, first: Filter, h: float):
        self.filters, self.logw = [first], np.zeros(1)
        self.h = h
        self.N = 0.003 / h
        self.ema, self.rest, self.alarms, self.i = 1.0, 0, [], 0
        self.extra = 0
        self.born = -1000
        self.quiet = first.Q_theta[0]

    def step(self, f, y):
        self.i += 1
        nis = np.zeros(len(self.filters))
        for j, F in enumerate(self.filters):
            nis[j], logdet = F.step(f, y)
            loss = nis[j] if nis[j] < 9 else 6 * np.sqrt(nis[j]) - 9
            self.logw[j] -= 0.5 * (loss * len(y) + logdet)
        self.logw -= self.logw.max()
        self.extra += len(self.filters) - 1
        best = int(np.argmax(self.logw))
        keep = (self.logw > -12) | (self.i < self.born + 0.005 / self.h)
        if not keep.all():
            self.filters = [F for F, k in zip(self.filters, keep) if k]
            self.logw = self.logw[keep]
            nis = nis[keep]
            best = int(np.argmax(self.logw))
        self.ema += (min(nis[best], 50) - self.ema) / self.N
        self.rest -= 1
        if self.rest < 0 and len(self.filters) > 1:
            self.filters, self.logw, best = [self.filters[best]], np.zeros(1), 0
            self.filters[0].Q_theta[0] = self.quiet
        if self.ema > 1 + 7 * np.sqrt(1 / self.N) and self.rest < 0:
            self.alarms.append(self.i * self.h)
            self.rest, self.ema = int(0.02 / self.h), 1.0
            base = self.filters[best]
            made = []
            for d in self.SPREAD:
                F = copy.deepcopy(base)
                q = 2 * F.r
                F.theta = F.theta.copy()
                F.theta[0] += d
                F.P[q, :] = F.P[:, q] = 0
                F.P[q, q] = 0.15**2
                F.Q_theta = F.Q_theta.copy()
                F.Q_theta[0] = WALK**2 * self.h
                made.append(F)
            self.born = self.i
            self.filters, self.logw, best = made, -0.5 * (self.SPREAD / 0.6) ** 2, 5
        self.best = self.filters[best]
        return nis[min(best, len(nis) - 1)]
