"""Which candidates fit: single linear effects, pairs, force laws.

==============  ====================================================  ====================
module          what it holds                                         start here
==============  ====================================================  ====================
``starts``      where a fit begins next to the nominal model          ``promises``
``race``        candidates against each other, those behind drop out  ``race``
``nominal``     the nominal model: recalibrated, or strained          ``recalibrate``
``linear``      single linear effects                                 ``search``
``pairs``       two linear effects at once                            ``pairs``
``joint``       an unknown mechanism at one node, as a passive law    ``find_joint``
``strategies``  how the fits of an effect begin, where it is special  ``strategy_of``
``laws``        nonlinear effects                                     ``search_laws``
==============  ====================================================  ====================
"""
