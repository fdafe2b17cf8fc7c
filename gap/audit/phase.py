"""Phase of a run: delay of its sensors, and polarity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class PhaseLimits:
    """Where delays and signs are looked for, and thresholds of the findings about them."""

    longest_delay: float = 0.4  # that is looked for, in periods of the first resonance, ...
    longest_periods: float = 10.0  # ... and of the highest frequency
    delay_phase: float = 0.05  # [rad] at the highest line: 3 degrees, 5 % of the response
    delay_errors: float = 5.0  # standard errors
    # Times zeta / omega of the most damped mode. Dampers in the bearings make modes complex, by phases of about zeta,
    # which look like a delay of zeta / omega.
    delay_complex: float = 1.5
    delay_widths: float = 3.0  # lines for the delay are farther than so many half-power widths from a resonance
    delay_lines: int = 12  # and so many at least
    clear_cosine: float = 0.5  # a response is in phase or out of phase above it
    # Phases are followed through lines within so many half-power widths of a resonance, or so many lines.
    round_widths: float = 2.0
    round_lines: int = 2
    clear_step: float = 2.5  # [rad] phases turn by less from line to line
    rises: float = 0.5  # [rad] gain from which phases rise: through a resonance of a rotor they lose up to pi
    low: float = 0.85  # low lines are below this share of the first resonance
    low_lines: int = 3  # and so many at least


_LIMITS = PhaseLimits()


@dataclass(frozen=True)
class Delays:
    """Delay of every live channel of the exciter's plane against the force."""

    place: np.ndarray  # (n,) index among the live channels
    delay: FloatArray  # (n,) [s], positive: the response is late
    std: FloatArray  # (n,) [s]
    ambiguity: float  # [s] what complex modes may feign

    @property
    def common(self) -> tuple[float, float]:
        """Median delay and its standard error [s], from the channels' own errors or their spread, if that is larger."""
        middle = float(np.median(self.delay))
        spread = 1.48 * float(np.median(np.abs(self.delay - middle)))
        return middle, 1.25 * max(float(np.median(self.std)), spread) / np.sqrt(len(self.delay))


def find_delays(p: CheckedRun) -> Delays | None:
    """Delays by a sum of the run's own modes with real residues, rotated by e^{-i omega T}.

    H_c e^{i omega T} = (i omega)^n [sum_r A_cr / (omega_r^2 - omega^2 + 2 i zeta_r omega_r omega)
                                     + B_c + C_c omega^2 + D_c / omega^2],

    A, B, C, D real: a lightly damped rotor that does not spin has real modes. None where phase,
    resonances or lines are missing.
    """
    resonances = [r for r in p.resonances if np.isfinite(r.damping_ratio)]
    use = p.away(_LIMITS.delay_widths)
    places = [i for i, c in enumerate(p.channels) if c.plane == p.run.excitation_plane]
    columns = len(resonances) + 3
    enough = np.count_nonzero(use) >= max(_LIMITS.delay_lines, columns + 4)
    if p.run.magnitude_only or not resonances or not places or not enough:
        return None
    w = 2 * np.pi * p.f[use]
    modes = [1 / (q**2 - w**2 + 2j * r.damping_ratio * q * w) for r in resonances if (q := 2 * np.pi * r.frequency_hz)]
    scale = float(np.median(w))
    rest = [np.ones_like(w), (w / scale) ** 2, (scale / w) ** 2]
    base = np.stack([*modes, *rest], axis=1)  # (n, columns)
    longest = min(_LIMITS.longest_delay / resonances[0].frequency_hz, _LIMITS.longest_periods / p.f[-1])
    found = [_delay(w, base, p.receptance[use, i], p.std[use, i] / np.abs(p.H[use, i]), longest) for i in places]
    known = [k for k, (_, error) in enumerate(found) if np.isfinite(error)]
    if not known:
        return None
    delay, std = np.array([found[k] for k in known]).T
    most = max(r.damping_ratio / (2 * np.pi * r.frequency_hz) for r in resonances)
    return Delays(np.array(places)[known], delay, std, _LIMITS.delay_complex * most)


def _delay(w: FloatArray, base: np.ndarray, y: np.ndarray, relative: FloatArray, longest: float) -> tuple[float, float]:
    """Delay of one channel [s] and its standard error: best of a raster up to the longest one, then Gauss-Newton."""
    size = np.abs(y)
    weight = 1 / np.maximum(size * np.maximum(relative, 1e-3), 1e-2 * np.median(size))
    A = base * weight[:, None]
    stack = np.concatenate([A.real, A.imag])
    Q = np.linalg.qr(stack / np.maximum(np.linalg.norm(stack, axis=0), np.finfo(float).tiny))[0]
    raster = np.linspace(-longest, longest, 1 + 2 * int(np.ceil(longest * w[-1] / (2 * np.pi) * 16)))

    def left(T: FloatArray, factor: complex | np.ndarray = 1.0) -> FloatArray:
        """(n_T, 2n) what the modes do not explain of factor * y e^{i omega T}."""
        Y = factor * weight * y * np.exp(1j * np.outer(T, w))
        flat = np.concatenate([Y.real, Y.imag], axis=1)
        return flat - (flat @ Q) @ Q.T

    T = raster[np.argmin(np.sum(left(raster) ** 2, axis=1))]
    error = np.inf
    for _ in range(6):
        residual, slope = left(np.array([T]))[0], left(np.array([T]), 1j * w)[0]
        curvature = float(slope @ slope)
        freedom = len(residual) - base.shape[1] - 1
        if not curvature > 0:
            return 0.0, np.inf
        T = float(np.clip(T - (slope @ residual) / curvature, -longest, longest))
        error = float(np.sqrt(residual @ residual / freedom / curvature))
    return T, error


def check_delay(p: CheckedRun, delays: Delays | None) -> Iterator[Finding]:
    """Delay common to all channels, and channels with one of their own."""
    if delays is None:
        return
    common, error = delays.common
    limit = max(_LIMITS.delay_phase / (2 * np.pi * p.f[-1]), _LIMITS.delay_errors * error, delays.ambiguity)
    if abs(common) > limit:
        late = "late" if common > 0 else "early"
        words = f"The responses are {_micro(common)} +- {_micro(error)} us {late} against the force (a phase that grows"
        words += " with frequency); correct the phase or let the diagnosis fit a delay."
        yield p.finding("delay", "warning", words, common, limit)
    else:
        words = f"No delay against the force: {_micro(common, signed=True)} +- {_micro(error)} us."
        yield p.finding("delay", "ok", words, common, limit)
    off = np.abs(delays.delay - common) > np.maximum(2 * limit, _LIMITS.delay_errors * delays.std)
    if len(delays.delay) >= 3:
        for i in np.flatnonzero(off):
            own = float(delays.delay[i] - common)
            late = "late" if own > 0 else "early"
            words = f"Channel {p.channels[delays.place[i]]} is {_micro(own)} us {late} against the "
            words += "other channels; check its conditioner and filter."
            yield p.finding("delay", "warning", words, own, 2 * limit)


def _micro(seconds: float, *, signed: bool = False) -> str:
    value = seconds * 1e6 if signed else abs(seconds) * 1e6
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def check_sign(p: CheckedRun, geometry: Geometry, delays: Delays | None) -> Iterator[Finding]:
    """Channels against what a quasi-static push must do, and the drive point against passivity."""
    if p.run.magnitude_only or not len(p.live):
        return
    y: Any = p.receptance
    rise = _rise(p)
    if rise > _LIMITS.rises:
        words = f"The phase rises by {np.degrees(rise):.0f} degrees through the resonances, where that of a rotor falls"
        words += ": the responses are conjugated, as with e^(-i omega t)"
        yield p.finding("sign", "error", f"{words}; change the sign of the imaginary parts.", rise, _LIMITS.rises)
        y = y.conj()
    judged = _signs(p, geometry, y)
    if delays is not None:  # bent peaks can look like a delay; an inverted sensor shows with and without the correction
        on_time = _signs(p, geometry, y * np.exp(1j * 2 * np.pi * p.f[:, None] * delays.common[0]))
        judged = {place: max(sign, judged.get(place, 1)) for place, sign in on_time.items()}
    if not judged:
        words = "Polarity cannot be judged: no lines lie below the first resonance and the drive point was not measured"
        yield p.finding("sign", "note", f"{words}; check it by hand.")
        return
    inverted = [place for place, sign in judged.items() if sign < 0]
    if not inverted:
        words = f"The polarity of {len(judged)} of {len(p.live)} channels agrees with the force's"
        yield p.finding("sign", "ok", f"{words}.", 0.0, 0.0)
    elif len(inverted) == len(judged) and len(judged) > 1:
        words = "Every channel moves against the force below the first resonance: the force signal is inverted"
        yield p.finding("sign", "error", f"{words}; change its sign.", float(len(inverted)), 0.0)
    else:
        who = listed(p.channels[i] for i in inverted)
        words = f"Channel {who} has the opposite sign of what this force must do: the sensor or its cable is inverted"
        yield p.finding("sign", "error", f"{words}; change the sign.", float(len(inverted)), 0.0)


def _rise(p: CheckedRun) -> float:
    """Median rise of the phase through the resonances [rad]; nan where lines are too far apart."""
    rises = []
    for r in p.resonances:
        width, step = np.nan_to_num(r.half_power_hz), np.gradient(p.f)[r.line]
        reach = max(_LIMITS.round_widths * width, _LIMITS.round_lines * step)
        near = p.H[np.abs(p.f - r.frequency_hz) <= reach]
        steps = np.angle(np.sum(near[:-1].conj() * near[1:], axis=1))
        if len(steps) and np.abs(steps).max() < _LIMITS.clear_step:
            rises.append(float(steps.sum()))
    return float(np.median(rises)) if rises else np.nan


def _signs(p: CheckedRun, geometry: Geometry, y: Any) -> dict[int, int]:
    """+1 or -1 (inverted) by live channel: from low lines, or else of the drive point; empty where nothing tells."""
    return _low_signs(p, geometry, y) or _drive_sign(p, y)


def _low_signs(p: CheckedRun, geometry: Geometry, y: Any) -> dict[int, int]:
    """+1 or -1 (inverted) by live channel, from lines below the first resonance; empty where they do not tell."""
    expected = geometry.low_response(p.run)
    if expected is None or not p.resonances:
        return {}
    signs, first_hz = expected
    first = p.resonances[0].frequency_hz
    low = np.flatnonzero(p.f < _LIMITS.low * first)
    # That this is the first mode: not above the stiffest rig's, and nothing falls off from a mode below.
    if len(low) < _LIMITS.low_lines or first > 1.3 * first_hz.max() or _falls_off(np.linalg.norm(y[low], axis=1)):
        return {}
    cosine = np.median(y[low].real / np.abs(y[low]), axis=0)
    found = {}
    for i, channel in enumerate(p.channels):
        own = channel.plane == p.run.excitation_plane and 1 <= channel.node <= len(signs)
        if own and signs[channel.node - 1] and abs(cosine[i]) > _LIMITS.clear_cosine:
            found[i] = int(np.sign(cosine[i]) * signs[channel.node - 1])
    return found


def _falls_off(size: FloatArray) -> bool:
    """Whether a response is larger at its beginning than at its end."""
    third = max(len(size) // 3, 1)
    return bool(np.median(size[:third]) > np.median(size[-third:]))


def _drive_sign(p: CheckedRun, y: np.ndarray) -> dict[int, int]:
    """The same of the drive point: whether the force feeds energy in at its first resonance, Im H <= 0."""
    run = p.run
    places = [i for i, c in enumerate(p.channels) if (c.node, c.plane) == (run.excitation_node, run.excitation_plane)]
    if not places or not p.resonances or run.spin_rpm:
        return {}
    value = y[p.resonances[0].line, places[0]]
    sine = value.imag / abs(value) if value else 0.0
    return {places[0]: -int(np.sign(sine))} if abs(sine) > _LIMITS.clear_cosine else {}
