"""Diagnoses against sealed labels.

==============  =================================================  =================
module          what it holds                                      start here
==============  =================================================  =================
``statistics``  Wilson intervals, AUROC, Brier score, calibration  ``Rate``
``score``       diagnoses against labels; figures of groups        ``read_outcomes``
``bars``        what has to be reached, and whether it is          ``bars``
``real_bars``   the same for rotors of several sizes (W9)          ``real_bars``
``page``        the page of the benchmark                          ``page``
``results``     judged campaigns as rows of JSON                   ``to_row``
==============  =================================================  =================
"""
