"""How well a candidate explains the runs, and how probable that makes it.

==============  ======================================================================  ==================
module          what it holds                                                           start here
==============  ======================================================================  ==================
``hypotheses``  candidates: which effects, where, with which free numbers               ``candidates``
``observed``    measured runs with their errors, and the residuals of a model           ``Observed``
``modes``       resonances that runs show, and how far a model's are from them          ``measured_modes``
``nuisances``   gains, drifts, levels and tolerances that nobody knows exactly          ``Nuisances``
``problem``     the runs, the model of each, and problems derived from these            ``Problem``
``fitting``     the joint fit of a candidate's numbers and the nuisances                ``fit``
``descent``     least squares by damped steps, within ranges                            ``minimise``
``fit``         a candidate at its best, and its evidence                               ``Fit``
``score_test``  what one more number could gain, to first order                         ``Score``
``evidence``    the evidence by importance sampling                                     ``sample``
``posterior``   what the data leave open of all numbers, repeatabilities included       ``posterior``
``harmonics``   what measured harmonics say of candidates                               ``with_harmonics``
==============  ======================================================================  ==================
"""
