"""Starts for linear effects whose misfit has minima that no ordinary descent finds.

=====================  ========================================================  ==============
module                 what it holds                                             start here
=====================  ========================================================  ==============
``bearing_stiffness``  the bearings' stiffness line by line, and laws that       ``law_starts``
                       resemble it
``dwell``              the dwell of a fast sweep: thousands of minima            ``dwell_fits``
=====================  ========================================================  ==============
"""
