"""The paper's Fig. 2 and Fig. 3."""

from __future__ import annotations

import numpy as np

from benchmarks.page import COLOURS, new_figure, save_figure
from benchmarks.reproduction.amplitudes import displacement, resonance
from benchmarks.reproduction.nominal import paper, system, two_frequencies_hz

K_B_FIGURE_3 = 1e7


def figure_2() -> str:
    """First two frequencies over bearing stiffness."""
    stiffness = np.geomspace(1e5, 1e15, 201)
    f = np.array([two_frequencies_hz(system(k)) for k in stiffness])
    figure, axes = new_figure("bearing stiffness k_b, N/m", "natural frequency, Hz")
    printed = paper()["table1"]
    for mode in (0, 1):
        axes.semilogx(stiffness, f[:, mode], color=COLOURS[mode], label=f"f{mode + 1}")
        axes.plot(printed["k_b"], printed[f"program_f{mode + 1}"], "o", color=COLOURS[mode], markerfacecolor="white")
    axes.plot([], [], "o", color="0.3", markerfacecolor="white", label="printed in Table 1")
    axes.set(ylim=(0, 350), xlim=(1e5, 1e15))
    axes.legend(frameon=False, loc="center right")
    plot = save_figure(
        figure, "frequencies_over_stiffness", "Fig. 2: the first two bending frequencies over bearing stiffness"
    )
    return f"""## Fig. 2: frequencies over bearing stiffness

{plot}
The frequencies rise between 1e5 and about 1e8 N/m and are constant above that, as in the figure of the paper. On soft
bearings the deflection is mostly in the bearings, and on stiff bearings it is mostly in the shaft. Bearings stiffer
than 1e8 N/m cannot be identified, because they shift the first frequency by less than half a hertz. (Above 1e14 N/m the
curve shows the rigid support.)
"""


def figure_3() -> str:
    """Harmonic response at node 2."""
    supported = system(K_B_FIGURE_3)
    peaks = two_frequencies_hz(supported)
    around = np.outer(peaks, 1 + np.linspace(-0.02, 0.02, 401)).ravel()
    lines = np.unique(np.concatenate([np.linspace(1.0, 350.0, 1397), around]))
    figure, axes = new_figure("frequency, Hz", "displacement amplitude at node 2, m")
    axes.semilogy(lines, displacement(supported, lines), color=COLOURS[0], label="ours, 1 N at node 2")
    coarse = np.arange(5.0, 351.0, 5.0)
    axes.semilogy(coarse, displacement(supported, coarse), ".", color=COLOURS[1], label="the same every 5 Hz")
    top = paper()["figure3"]["amplitude_axis_top_m"]
    axes.axhline(top, color="0.4", linewidth=1, linestyle=":")
    axes.text(197, top * 1.12, "top of the paper's axis", ha="center", fontsize=8, color="0.3")
    axes.set(xlim=(0, 350))
    axes.legend(frameon=False)
    plot = save_figure(figure, "harmonic_response", "Fig. 3: harmonic response at node 2, k_b = 1e7 N/m")
    peak = resonance(K_B_FIGURE_3, displacement)
    second = float(displacement(supported, peaks[1:])[0])
    return f"""## Fig. 3: harmonic response

{plot}
The axis of the paper's figure ends at {top:.0e} m, and the paper does not give its force. So only the shape can be
compared: the first peak at {peak.frequency_hz:.1f} Hz is higher than the second at {peaks[1]:.1f} Hz
({peak.amplitude / second:.1f} times its height).

A force of 1 N at node 2 gives an exact peak of {peak.amplitude:.2e} m. A force of {1e3 * top / peak.amplitude:.0f} mN
would bring the peak to the top of the paper's axis. The frequency raster of the paper is unknown and misses the peak
(the dots show by how much), so its force may have been several times larger.
"""
