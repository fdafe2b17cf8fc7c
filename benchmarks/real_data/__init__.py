"""Diagnoses of what other laboratories measured; their data are read where they lie and never kept here.

================  ==========================================================  =====================
module            what it holds                                               start here
================  ==========================================================  =====================
``data_set``      what a data set is, and what is missing of it               ``DataSet``
``bolted_beam``   two beams on a lap joint, stepped sine                      ``BOLTED_BEAM``
``joint_law``     a joint whose stiffness and loss follow its angle           ``fit_law``
``single_mode``   one mode, with and without a damping that grows             ``leave_one_out``
``cantilever``    a strip with small masses, hammer                           ``CANTILEVER``
``diagnosing``    a fold: diagnose, predict, compare                          ``judged``
``report``        the page                                                    ``page``
``__main__``      ``python -m benchmarks.real_data FOLDER --page docs/real-data.md``
================  ==========================================================  =====================
"""
