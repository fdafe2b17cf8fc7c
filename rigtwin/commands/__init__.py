"""What each command does: parse, call, print; no physics.

===================  ================================================  =======================
module               what it holds                                     start here
===================  ================================================  =======================
``asked_rotor``      the rotor that a command is asked about           ``asked_rotor``
``settings``         --effect and --set                                ``parse_effects``
``fmus``             FMUs as commands need them: built, opened, asked  ``rotor_fmu``
``build``            rigtwin build                                     ``build_fmus``
``sweep``            rigtwin sweep                                     ``run_sweep``
``estimate``         rigtwin estimate                                  ``estimate``
``training``         rigtwin train                                     ``train``
``check``            rigtwin check: the gates                          ``run_gates``
``junit``            a gate, and all of them as a JUnit report         ``write_junit``
``diagnose``         rigtwin diagnose and rigtwin predict              ``run_diagnose``
``blind``            rigtwin blind                                     ``run_blind``
``effects``          rigtwin effects                                   ``print_effects``
``modes``            rigtwin modes                                     ``run_modes``
``campbell``         rigtwin campbell                                  ``run_campbell``
``critical_speeds``  rigtwin critical-speeds                           ``run_critical_speeds``
``unbalance``        rigtwin unbalance                                 ``run_unbalance``
``files``            rigtwin inspect and rigtwin convert               ``inspect_file``
``reduce``           rigtwin reduce: a run from time records           ``run_reduce``
``demo``             rigtwin demo                                      ``run_demo``
``paper``            the paper's measured numbers, read by our model   ``read_paper``
``report``           rigtwin report                                    ``write_report``
===================  ================================================  =======================
"""
