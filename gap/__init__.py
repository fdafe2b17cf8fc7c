"""Diagnosis of the gap between a measured rotor and its model: where, which effect, how far it shrinks.

====================  ============================================================  =====================
module                what it holds                                                 start here
====================  ============================================================  =====================
``diagnose``          a campaign in, a diagnosis out: the order of everything       ``diagnose``
``prepare``           a campaign's model, runs and recalibrated nominal model       ``prepared``
``audit``             is the measurement itself sound?                              ``audit``
``hypotheses``        candidates: which effect, where, with which free numbers      ``candidates``
``forward``           rotors built and solved: the model of the measured runs       ``Forward``
``modal``             the response of a run, resonance by resonance                 ``Modal``
``tolerances``        how modulus, span and disk masses bend the modes              ``bend_of``
``residuals``         measured runs with their errors, and what a model leaves      ``Observed``
``likelihood``        the runs' models, nuisances, and their joint fit              ``Problem``
``descent``           least squares by damped steps, within ranges                  ``minimise``
``fit``               a candidate at its best, and its evidence                     ``Fit``
``score``             what one more number could gain, to first order               ``Score``
``evidence``          how far Laplace's approximation is to be believed             ``sample``
``starts``            where a candidate's fit begins                                ``points``
``bearing_stiffness`` what carries the shaft, line by line; laws that resemble it   ``carried``
``search``            linear effects                                                ``search``
``pair_search``       pairs of them                                                 ``pairs``
``dwell``             the one number with thousands of minima: a fast sweep's       ``dwell_fits``
``transients``        what a fast sweep leaves of a rotor's transients              ``transients``
``nonlinear``         the model of a run under a force law, by harmonic balance     ``NonlinearModal``
``robust``            fits that lines on another branch do not decide               ``robust_fit``
``law_grid``          points over a law's numbers to begin from                     ``points_of``
``law_reading``       a law's numbers, read without solving for a motion            ``read``
``nonlinear_search``  nonlinear effects                                             ``search_nonlinear``
``helpers``           fits that are shared with other processes                     ``helped_by``
``adequacy``          is a fit as good as the noise allows?                         ``judge``
``standing``          how far the best fit is to be believed                        ``standing_of``
``ranking``           candidates by probability, and the verdict                    ``rank``
``report``            the answer as a diagnosis                                     ``report``
``where``             shares of the gap, and the joint stiffness of a place         ``locate``
``held_out``          how far the gap shrinks on lines that were left out           ``measure_shrink``
``transfer``          how far it will shrink where another node is driven           ``transfer_interval``
``next_test``         the run that would tell the causes apart                      ``best_next_test``
``missing_test``      what to measure next, by what the campaign lacks              ``missing_test``
``peaks``             campaigns of which only resonances survive                    ``diagnose_peaks``
``resonances``        a candidate's resonances over k_b                             ``Resonances``
``predict``           what a diagnosis says of runs that it never saw               ``predict``
``curves``            measured runs beside their models                             ``nrmse``
``causes``            a fitted candidate as diagnosis.json names it                 ``cause_of``
``wording``           the verdict in a sentence                                     ``sentence``
``phrases``           places, parts of a whole and lists in words                   ``place``, ``part``, ``listed``
``diagnosis``         the contents of diagnosis.json                                ``Diagnosis``
``blind``             the benchmark: a generator that imports nothing of the above
====================  ============================================================  =====================
"""
