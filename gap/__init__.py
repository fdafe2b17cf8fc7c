"""Diagnosis of the gap between a measured rotor and its model: where, which effect, how far it shrinks.

=============  ==========================================================================  =====================
room           what it holds                                                               start here
=============  ==========================================================================  =====================
``diagnose``   a campaign in, a diagnosis out: the order of everything                     ``diagnose``
``prepare``    a campaign's model, runs and recalibrated nominal model                     ``prepared``
``explain``    which effects explain the runs: the order of the searches                   ``explain``
``audit``      is the measurement itself sound?                                            ``audit.findings``
``model``      rotors built and solved: the model of a measured run                        ``model.forward``
``inference``  how well a candidate explains the runs, and how probable that makes it      ``inference.problem``
``search``     which candidates are fitted, and from where: linear effects, pairs, laws    ``search.linear``
``verdict``    is a fit as good as the noise allows? candidates by probability             ``verdict.ranking``
``answer``     causes, where the gap lies, how far it shrinks, what to measure next        ``answer.report``
``peaks``      campaigns of which only resonances are known                                ``peaks.lists``
``predict``    what a diagnosis predicts for runs that took no part in it                  ``predict``
``curves``     measured runs beside their models                                           ``nrmse``
``phrases``    places, parts of a whole and lists in words                                 ``place``, ``part``
``document``   the contents of diagnosis.json                                              ``Diagnosis``
``clock``      seconds that each step of a diagnosis takes                                 ``Clock``
=============  ==========================================================================  =====================
"""
