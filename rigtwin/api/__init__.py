"""What the commands do, as Python functions: the names that ``import rigtwin`` has.

===================  ====================================================  ====================
module               what it holds                                         start here
===================  ====================================================  ====================
``rigs``             rigs, their model, the library of effects             ``load_rig``
``runs``             measured data, and the modes of a run                 ``load_campaign``
``fmus``             FMUs built, opened, asked                             ``build_fmu``
``values``           values as the variables of an FMU have them           ``as_kind``
``sweeps``           stepped-sine runs on the virtual rig                  ``sweep``
``responses``        k_b by all lines of measured responses                ``fit_responses``
``workshop_errors``  what a usual rig's tolerances do to k_b               ``workshop_error``
``estimates``        bearing stiffness from runs, lists, numbers           ``estimate``
``diagnoses``        the diagnosis of a campaign                           ``diagnose``
``predictions``      a diagnosis applied to runs that it never saw         ``predict``
``comparisons``      two campaigns of one rig beside each other            ``compare``
``reports``          one page of measured runs                             ``report``
``checks``           the gates an FMU has to pass                          ``check_fmu``
``junit``            a gate, and all of them as a JUnit report             ``write_junit``
===================  ====================================================  ====================

A function raises ``UserError`` for all that is wrong with its input, writes no file that it was not asked for, and
prints nothing. The commands print what it returns.
"""
