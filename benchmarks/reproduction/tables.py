"""Table 1 (frequencies) and the frequency shifts of Table 2."""

from __future__ import annotations

import numpy as np

from benchmarks.page import bar, power_of_ten, table
from benchmarks.reproduction.condensation import condense_tilt
from benchmarks.reproduction.nominal import condition, paper, percent, system, two_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.elements import euler_bernoulli, linear_timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem

RIGID = 1e15


def table_1() -> str:
    """Table 1: the program's and ANSYS' frequencies."""
    program, program_bar = _program_columns()
    ansys, ansys_bar = _ansys_columns()
    return f"""## Table 1: natural frequencies

### The program's columns

Our model has six Timoshenko elements, with the disks as point masses at nodes 3 and 5. Nothing else was adjusted. The
columns "condensed" belong to the same model with the rotations removed by static condensation, as the paper does.

{program}
{program_bar}
What differs and why:

- The paper prints E as "207e11 GPa". We take it as 207 GPa, which is the value of steel. With any other power of ten
  the frequencies would be wrong by large factors.
- Static condensation does not explain the difference. It changes f1 by one part in a million and f2 by 0.002 %.
- The paper's "1e15 N/m" is a rigid support in our model. A spring of that stiffness would give the same rotor with more
  round-off.
- What remains is 0.5 % in f1 and 0.2 to 0.3 % in f2. One wrong material constant cannot explain it, because on rigid
  supports E and the density change every frequency by the same ratio. Other ways to read the paper do not give both
  frequencies either, as the next table shows, so nothing was adjusted:

{_variants()}
### The ANSYS columns

The paper says that its own frequencies are lower than those of ANSYS "as present program adopts the Timoshenko
formulation". But the ANSYS element BEAM188 is a Timoshenko element too. In its default setting it interpolates the
deflection and the rotation by straight lines and integrates at one point. Its curvature is therefore constant within an
element, and six such elements are too stiff.

Our implementation of that element is `linear_timoshenko` in `rotor/model/elements.py`. It agrees with the ANSYS columns
within 2 %, while the cubic element differs from them by up to 7 %:

{ansys}
{ansys_bar}
{_linear_convergence()}"""


def _program_columns() -> tuple[str, str]:
    rows, differences = [], []
    for mode, column in enumerate(("program_f1", "program_f2")):
        for k_b, theirs in zip(paper()["table1"]["k_b"], paper()["table1"][column], strict=True):
            full = two_frequencies_hz(system(k_b))[mode]
            condensed = two_frequencies_hz(condense_tilt(system(k_b)))[mode]
            differences += [abs(percent(full, theirs)), abs(percent(condensed, theirs))]
            rows.append(
                (
                    *(f"f{mode + 1}", power_of_ten(k_b), f"{theirs:.3f}"),
                    *(cell for f in (full, condensed) for cell in (f"{f:.3f}", f"{percent(f, theirs):+.2f}")),
                )
            )
    header = ("mode", "k_b, N/m", "paper, Hz", "ours, Hz", "diff., %", "ours condensed, Hz", "diff., %")
    return table(header, rows), bar(
        "Table 1, program columns, largest difference", max(differences), at_most=0.6, unit="%"
    )


def _variants() -> str:
    """What other readings of the paper would give on rigid supports."""
    program = (paper()["table1"]["program_f1"][0], paper()["table1"]["program_f2"][0])
    readings = {
        "as above": system(RIGID),
        "no shear, no rotary inertia (Euler-Bernoulli)": system(RIGID, element=euler_bernoulli),
        "shear factor 3/4": _with_changes(segment={"shear_factor": 0.75}),
        "disks with rotary inertia": _with_changes(disk={"inertia": True}),
        "disks with a bore of 20 mm for the shaft": _with_changes(disk={"bore_m": 0.020}),
        "disks with rotary inertia and bore": _with_changes(disk={"bore_m": 0.020, "inertia": True}),
    }
    rows = [
        (
            name,
            *(f"{percent(f, printed):+.2f}" for f, printed in zip(two_frequencies_hz(reading), program, strict=True)),
        )
        for name, reading in readings.items()
    ]
    return table(("reading, rigid supports", "f1, diff., %", "f2, diff., %"), rows)


def _with_changes(**changes: dict[str, float | bool]) -> LinearSystem:
    """The paper's rotor on rigid supports with keys changed in every segment or disk."""
    tables = load_rig("nit-rourkela").model_dump(exclude_unset=True)
    for kind, keys in changes.items():
        for item in tables[kind]:
            item.update(keys)
    return build_system(assemble(Rig.model_validate(tables)), condition(RIGID))


def _ansys_columns() -> tuple[str, str]:
    rows, differences = [], []
    for mode, column in enumerate(("ansys_f1", "ansys_f2")):
        for k_b, theirs in zip(paper()["table1"]["k_b"], paper()["table1"][column], strict=True):
            cubic = two_frequencies_hz(system(k_b))[mode]
            linear = two_frequencies_hz(system(k_b, element=linear_timoshenko))[mode]
            differences.append(abs(percent(linear, theirs)))
            rows.append(
                (
                    *(f"f{mode + 1}", power_of_ten(k_b), f"{theirs:.2f}"),
                    *(cell for f in (cubic, linear) for cell in (f"{f:.2f}", f"{percent(f, theirs):+.2f}")),
                )
            )
    header = ("mode", "k_b, N/m", "ANSYS, Hz", "cubic element, Hz", "diff., %", "linear element, Hz", "diff., %")
    return table(header, rows), bar(
        "Table 1, ANSYS columns, largest difference", max(differences), at_most=2.5, unit="%"
    )


def _linear_convergence() -> str:
    spans = (1, 2, 4, 8, 16, 32)
    limit = two_frequencies_hz(system(RIGID, elements_per_span=32))
    linear = np.array(
        [two_frequencies_hz(system(RIGID, element=linear_timoshenko, elements_per_span=n)) for n in spans]
    )
    rows = [
        (
            f"{n}",
            f"{6 * n}",
            f"{f[0]:.3f}",
            f"{percent(f[0], limit[0]):+.4f}",
            f"{f[1]:.3f}",
            f"{percent(f[1], limit[1]):+.4f}",
        )
        for n, f in zip(spans, linear, strict=True)
    ]
    # The error falls with the square of the element length: one Richardson step removes most of it.
    extrapolated = linear[-1] + (linear[-1] - linear[-2]) / 3
    header = ("elements per span", "elements", "f1, Hz", "above ours, %", "f2, Hz", "above ours, %")
    claim = "linear element extrapolated to zero length against our converged mesh"
    return f"""On a finer mesh the frequencies of the linear element fall to the same limit as those of our element
({limit[0]:.3f} and {limit[1]:.3f} Hz on rigid supports with 32 cubic elements per span). Each halving of the element
length divides the error by four. So the ANSYS columns are too high because of a coarse mesh and not because of another
theory:

{table(header, rows)}
{bar(claim, float(np.abs(percent(extrapolated / limit, 1.0)).max()), at_most=0.001, unit="%")}"""


def table_2_shifts() -> str:
    """Frequency shifts of Table 2."""
    printed = paper()["table2"]
    rigid = two_frequencies_hz(system(RIGID))
    rows, differences = [], []
    for k_b, theirs in zip(printed["k_b"], zip(printed["df1_Hz"], printed["df2_Hz"], strict=True), strict=True):
        ours = rigid - two_frequencies_hz(system(k_b))
        difference = [percent(a, b) for a, b in zip(ours, theirs, strict=True)]
        differences += difference
        cells = [(f"{a:.3f}", f"{b:.3f}", f"{d:+.2f}") for a, b, d in zip(theirs, ours, difference, strict=True)]
        rows.append((power_of_ten(k_b), *cells[0], *cells[1]))
    header = ("k_b, N/m", "Δf1 paper, Hz", "ours", "diff., %", "Δf2 paper, Hz", "ours", "diff., %")
    return f"""## Table 2: frequency shifts

The frequency shift is the frequency on rigid supports minus the frequency on bearings. Both are computed with six
elements:

{table(header, rows)}
{bar("Table 2, largest difference of the 24 shifts", max(np.abs(differences)), at_most=3.5, unit="%")}
All 24 shifts are larger than those of the paper, by {min(differences):.1f} to {max(differences):.1f} %. The cause is
the small difference of Table 1. It counts for more here, because a shift is the small difference of two frequencies.
The text of the paper does not allow us to find its origin in the paper's program. The two shifts at 1e8 N/m are the
smallest ones and therefore the most affected.
"""
