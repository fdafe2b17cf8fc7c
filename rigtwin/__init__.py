"""The ``rigtwin`` command and its report pages: parse, call, print.

=====================  ================================================  ========================
module                 what it holds                                     start here
=====================  ================================================  ========================
``cli``                the commands and their options                    ``app``
``exits``              exit codes, and what a user sees of an error      ``CommandGroup``
``interrupt``          Ctrl-C and SIGTERM                                ``install``
``console``            tables, progress bars, JSON                       ``progress``
``wording``            numbers as they are printed                       ``with_error``
``fmus``               FMUs as commands need them: built, opened, asked  ``rotor_fmu``
``build``              rigtwin build                                     ``build_fmus``
``sweep``              rigtwin sweep                                     ``run_sweep``
``estimate``           rigtwin estimate                                  ``estimate``
``training``           rigtwin train                                     ``train``
``check``              rigtwin check: the gates                          ``run_gates``
``diagnose``           rigtwin diagnose and rigtwin predict              ``run_diagnose``
``blind``              rigtwin blind                                     ``run_blind``
``effects``            rigtwin effects                                   ``print_effects``
``scale_out``          processes here, or the workers of a dask cluster  ``executor``
``junit``              the gates as a JUnit report                       ``write_junit``
``demo``               rigtwin demo                                      ``run_demo``
``paper``              the paper's measured numbers, read by our model   ``read_paper``
``report``             rigtwin report                                    ``write_report``
``figures``            plotly figures and the picture of the rotor       ``frf_figure``
``diagnosis_page``     the page of a diagnosis                           ``write_diagnosis_page``
``diagnosis_figures``  its figures                                       ``response_figure``
``diagnosis_words``    what a diagnosis says, in words                   ``named``
``effect_pages``       the pages of docs/effects                         ``pages``
``effect_figures``     which panels show which effect                    ``EffectFigure``
``effect_plots``       those panels                                      ``paper_rotor``
``page``               one self-contained HTML page                      ``write_page``
``provenance``         versions, GUIDs, hashes                           ``provenance``
=====================  ================================================  ========================

No physics here: everything is computed by the rooms it calls.
"""
