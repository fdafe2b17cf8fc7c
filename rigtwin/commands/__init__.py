"""What each command reads and prints; what it does is a function of ``rigtwin.api``, where it has one.

====================  ================================================  =======================
module                what it holds                                     start here
====================  ================================================  =======================
``settings``          effects and ``--set`` of the command line         ``parse_effects``
``build``             rigtwin build                                     ``build_fmus``
``sweep``             rigtwin sweep                                     ``run_sweep``
``estimate``          rigtwin estimate                                  ``print_answers``
``training``          rigtwin train                                     ``train``
``tracker_training``  rigtwin train --tracker                           ``train_tracker``
``check``             rigtwin check                                     ``run_check``
``diagnose``          rigtwin diagnose and rigtwin predict              ``run_diagnose``
``compare``           rigtwin compare                                   ``run_compare``
``blind``             rigtwin blind                                     ``run_blind``
``effects``           rigtwin effects                                   ``print_effects``
``asked_rotor``       the rotor that the next four commands ask about   ``RotorRequest``
``modes``             rigtwin modes                                     ``run_modes``
``campbell``          rigtwin campbell                                  ``run_campbell``
``critical_speeds``   rigtwin critical-speeds                           ``run_critical_speeds``
``unbalance``         rigtwin unbalance                                 ``run_unbalance``
``system``            rigtwin system                                    ``run_system``
``files``             rigtwin inspect and rigtwin convert               ``inspect_file``
``reduce``            rigtwin reduce                                    ``run_reduce``
``demo``              rigtwin demo                                      ``run_demo``
``paper``             the paper's measured numbers, read by our model   ``read_paper``
``report``            rigtwin report                                    ``run_report``
``app``               rigtwin app                                       ``run_app``
====================  ================================================  =======================
"""
