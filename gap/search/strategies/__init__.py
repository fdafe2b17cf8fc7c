"""How the search of a candidate begins, and which effects need a way of their own.

=====================  ======================================================================  ===============
module                 what it holds                                                           start here
=====================  ======================================================================  ===============
``registry``           which effect has which strategy                                         ``strategy_of``
``strategy``           the default of linear effects                                           ``Strategy``
``along_shaft``        effects at any position along the shaft                                 ``AlongShaft``
``two_planes``         a difference between the two planes                                     ``TwoPlanes``
``dwell``              the dwell of a fast sweep, whose misfit has thousands of minima         ``dwell_fits``
``bearing_stiffness``  the bearings' stiffness line by line, and laws that resemble it         ``law_starts``
``law``                force laws                                                              ``LawStrategy``
=====================  ======================================================================  ===============
"""
