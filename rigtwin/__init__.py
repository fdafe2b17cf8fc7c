"""A rotor test rig and its digital twin.

=============  ==================================================================  ====================
room           what it holds                                                       start here
=============  ==================================================================  ====================
``rotor``      geometry, finite elements, effects, solvers                         ``load_rig``
``sim``        the virtual test rig, campaigns, file formats                       ``sweep``
``estimator``  the network that turns shifts and amplitude ratio into k_b          ``StiffnessEstimator``
``fmu_src``    what goes into the FMUs, and how they are built                     ``build_rotor_fmu``
``gap``        the diagnosis of the gap between a campaign and its model           ``diagnose``
``blind``      sealed campaigns of a second implementation, and their judge        ``make_all``
``commands``   what each ``rigtwin`` command does                                  ``run_diagnose``
``pages``      the HTML pages and their figures                                    ``write_page``
``cli``        the commands and their options                                      ``app``
``exits``      exit codes, and what a user sees of an error                        ``CommandGroup``
``interrupt``  Ctrl-C and SIGTERM                                                  ``install``
``console``    tables, progress bars, JSON                                         ``progress``
``workers``    processes that end with this one                                    ``worker_pool``
``scratch``    temporary folders, and files that are replaced as a whole           ``replacing``
``parsing``    TOML and JSON                                                       ``parse_toml``
``scale_out``  processes here, or the workers of a dask cluster                    ``executor``
``wording``    numbers as they are printed                                         ``with_error``
=============  ==================================================================  ====================
"""
