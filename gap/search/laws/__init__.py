"""Which nonlinear effect, and with which numbers.

===========  ==================================================================  ====================
module       what it holds                                                       start here
===========  ==================================================================  ====================
``beside``   laws alone and beside linear effects                                ``search_laws``
``search``   a grid, descents and fits of all nonlinear candidates               ``search_nonlinear``
``grid``     points over a law's numbers, and how far each is from the data      ``points_of``
``reading``  a law's numbers, read from the runs without solving for a motion    ``read``
``robust``   fits that lines on another branch of the response do not decide     ``robust_fit``
===========  ==================================================================  ====================
"""
