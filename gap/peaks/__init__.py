"""Campaigns of which only lists of resonances survive, and what a handful of numbers can and cannot tell.

==============  ================================================  ==================
module          what it holds                                     start here
==============  ================================================  ==================
``resonances``  resonances of a candidate's rotor over k_b        ``Rotor``
``lists``       how probable the lists are under a model          ``Lists``
``ranking``     evidence of every candidate, on a grid            ``rank``
``diagnosis``   what the ranking says, as a diagnosis             ``diagnose_peaks``
==============  ================================================  ==================
"""
