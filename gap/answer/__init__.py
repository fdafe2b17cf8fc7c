"""The answer: causes, where the gap lies, how far it shrinks, and what to measure next.

================  ============================================================  =====================
module            what it holds                                                 start here
================  ============================================================  =====================
``report``        ranked candidates as a diagnosis, with its curves             ``report``
``causes``        a fitted candidate as ``diagnosis.json`` names it             ``cause_of``
``calibration``   gains, tolerances and repeatabilities, before and after       ``calibration_of``
``where``         shares of the gap, and the joint stiffness of a place         ``locate``
``held_out``      how far the gap shrinks on lines that were left out           ``measure_shrink``
``joint``         an unknown mechanism at a node, as a file can hold it         ``unknown_joint``
``black_box``     a correction without a place: the control of that            ``further_resonance``
``transfer``      how far it will shrink where another node is driven           ``transfer_interval``
``next_run``      the run that separates the remaining causes                   ``best_next_test``
``missing_test``  what to measure next, by what the campaign lacks              ``missing_test``
``sentence``      the verdict in words                                          ``sentence``
================  ============================================================  =====================
"""
