"""Hide a collar of 60 g on the virtual rig and find it: python examples/diagnose_a_campaign.py

The rotor in RotorRig.fmu is measured with two stepped sines, on rigid supports and on bearings. It has a
collar that the nominal model lacks, and the diagnosis sees only the runs. Data of a real rig are loaded with
rigtwin.sim.campaign_folder.load_campaign, or diagnosed with the command rigtwin diagnose.
"""

import tempfile
from pathlib import Path

from rigtwin.fmu_src.build import build_rotor_fmu
from rigtwin.gap.diagnose import diagnose
from rigtwin.rotor.effects import EFFECTS, AttachedMass
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Campaign, NominalBelief
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

HIDDEN = AttachedMass(mass=0.06, node=4)  # [kg]
TRUTH = {"k_b": 3e6, "bearing_damping": 20.0, "shaft_damping_ratio": 0.003}  # [N/m], [N s/m], [-]

# Effects that are ruled out here: those of bearings and sensors, and the crack. Fewer candidates give a faster answer.
TRUSTED = [name for name, effect in EFFECTS.items() if effect.family != "structure" or name == "open_crack"]


def main() -> float:
    """Measure, diagnose, print; returns the mass found [kg]."""
    runs = []
    with (
        tempfile.TemporaryDirectory() as folder,
        FmuSession(build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))) as session,
    ):
        for seed, support in enumerate(("rigid", "bearing")):
            plan = SweepPlan(n_lines=64, noise=SensorNoise(relative=0.01, seed=seed))
            runs.append(sweep(session, Rig(support, parameters=TRUTH, effects=(HIDDEN,)), plan).run)

    belief = NominalBelief(TRUTH["shaft_damping_ratio"], TRUTH["bearing_damping"])
    found = diagnose(Campaign("a rotor with a secret", "nit-rourkela", tuple(runs), nominal=belief), TRUSTED).diagnosis

    print(found.sentence)
    for cause in found.causes[:3]:
        print(f"  {100 * cause.probability:6.2f} %  {EFFECTS[cause.effects[0]].title}")
    mass, k_b = found.causes[0].parameters["mass"], found.causes[0].k_b
    print(f"mass = {mass.value:.4f} +- {mass.std:.4f} kg, true {HIDDEN.mass:g} kg")
    assert found.verdict == "cause"
    assert (found.causes[0].effects, found.causes[0].location.node) == (("attached_mass",), HIDDEN.node)
    assert k_b is not None
    print(f"k_b = {k_b.value:.5g} +- {k_b.std:.1g} N/m, true {TRUTH['k_b']:g} N/m")
    # With noise of 1 % on every line the mass is found to a fraction of a percent.
    assert abs(mass.value / HIDDEN.mass - 1) < 0.02
    return mass.value


if __name__ == "__main__":
    main()
