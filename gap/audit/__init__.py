"""Audit of a measured campaign, before any effect is fitted and without trusting the model's calibration.

===============  ===============================================================  ===================
module           what it looks at                                                 start here
===============  ===============================================================  ===================
``findings``     the whole audit, and the campaign as it is diagnosed             ``audit``, ``usable``
``noise``        scatter of the lines about a smooth curve                        ``estimate_noise``
``wild``         single lines that nothing near them explains                     ``wild_lines``
``checked_run``  a run's clean lines, noise and resonances, for every check       ``CheckedRun``
``one_run``      raster, missing lines, noise, channels, saturation, sweep rate   ``check_raster`` ...
``phase``        delay and polarity                                               ``check_delay`` ...
``pairs``        reciprocity, repeatability, force level                          ``check_pairs``
``labels``       nodes, exciter, quantity, units and supports against the drawing ``check_labels``
``drawn``        a run's magnitudes beside the drawing's                          ``Curves``
``coverage``     what was not measured                                            ``check_coverage``
``geometry``     what the drawing says whatever the stiffnesses are               ``geometry_of``
===============  ===============================================================  ===================
"""
