"""A long campaign resets one instance again and again: it must not fill the memory."""

from __future__ import annotations

import pytest

from tests.fmu.child import in_child

# pythonfmu's glue leaks some 14 kB an instance, and every reset makes a new one; three times that
# leaves room for the allocator and still shows a leaked set of matrices.
LEAK_PER_INSTANCE = 3 * 14e3  # [bytes]


def resident_after(fmu, cycles):
    """Growth of resident memory over cycles of reset, run and read [bytes]."""
    import gc
    import os

    from rigtwin.sim.session import FmuSession

    def resident():
        gc.collect()
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    with FmuSession(fmu) as session:
        values = {"force_amplitude": 1.0} if "force_amplitude" in session.variables else {}
        for cycle in range(cycles + 20):
            if cycle == 20:
                before = resident()
            session.start(values)
            session.step(0.1)
            session.get(session.variables)
        return resident() - before


@pytest.mark.skipif("not __import__('sys').platform.startswith('linux')", reason="reads /proc")
def test_resets_do_not_pile_up_in_memory(fmu):
    assert in_child(resident_after, fmu, 300) < 300 * LEAK_PER_INSTANCE


def states_after(fmu, cycles):
    """Growth of resident memory over cycles of saving and restoring a state [bytes]."""
    import gc
    import os

    from rigtwin.sim.session import FmuSession

    def resident():
        gc.collect()
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    with FmuSession(fmu) as session:
        session.start()
        for cycle in range(cycles + 200):
            if cycle == 200:
                before = resident()
            session.restore_state(session.save_state())
        return resident() - before


@pytest.mark.skipif("not __import__('sys').platform.startswith('linux')", reason="reads /proc")
def test_saved_states_do_not_pile_up_in_memory(rotor_fmu):
    assert in_child(states_after, rotor_fmu, 3000) < 2e6  # a state is 3 kB: 9 MB, were they kept
