"""What each command reads and prints; what it does is a function of ``rigtwin.api``.

============  ================================================  =================
module        what it holds                                     start here
============  ================================================  =================
``build``     rigtwin build                                     ``build_fmus``
``sweep``     rigtwin sweep                                     ``run_sweep``
``estimate``  rigtwin estimate                                  ``print_answers``
``training``  rigtwin train                                     ``train``
``check``     rigtwin check                                     ``run_check``
``diagnose``  rigtwin diagnose and rigtwin predict              ``run_diagnose``
``compare``   rigtwin compare                                   ``run_compare``
``blind``     rigtwin blind                                     ``run_blind``
``effects``   rigtwin effects                                   ``print_effects``
``files``     rigtwin inspect and rigtwin convert               ``inspect_file``
``demo``      rigtwin demo                                      ``run_demo``
``paper``     the paper's measured numbers, read by our model   ``read_paper``
``report``    rigtwin report                                    ``run_report``
============  ================================================  =================
"""
