"""How far fits are to be believed, and what follows.

==============  ==========================================  ===============
module          what it holds                               start here
==============  ==========================================  ===============
``thresholds``  every number that decides an answer         ``THRESHOLDS``
``adequacy``    is a fit as good as the noise allows?       ``judge``
``standing``    how far the best fit is to be believed      ``standing_of``
``ranking``     candidates by probability, and the verdict  ``decide``
==============  ==========================================  ===============
"""
