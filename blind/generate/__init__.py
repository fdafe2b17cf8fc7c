"""Campaigns with a hidden cause, by a second implementation of the rotor.

=============  =========================================================  ===================
module         what it holds                                              start here
=============  =========================================================  ===================
``scale``      size of a rig in mass, length and time                     ``Scale``
``rig``        geometry from the rig's TOML, and how the rig is tested    ``read_rig``
``beam``       Timoshenko shaft in spectral elements                      ``build_shaft``
``effects``    what may be hidden: ids, ranges, places, how they fade     ``KINDS``
``strangers``  five mechanisms in nobody's library (W8, W9)               ``ADDERS``
``forms``      effects in other functional forms (W6)                     ``FORMS``
``draft``      the matrices while effects are put in                      ``Draft``
``machine``    matrices of a rotor with effects; drift of its resonances  ``build_machine``
``response``   steady response through the measurement chain              ``reported``
``transient``  a sweep that does not settle                               ``swept``
``laws``       nonlinear force laws, sampled over a period                ``law_of``
``nonlinear``  harmonic balance, stability, sweeps, force levels          ``swept_up``
``lines``      frequency lines as a lab chooses them                      ``choose_lines``
``case``       one campaign before it is written                          ``Case``
``detection``  detection limit of an effect                               ``Distance``
``wide``       the same where little is known of the rig (W9)             ``distance_for``
``sizes``      size of an effect over its detection limit                 ``size_ratio``
``draw``       what each of the sets W1 to W8 draws                       ``draw_campaign``
``real_rigs``  what W9 draws: rotors of three sizes                       ``draw_real``
``label``      the sealed label of a campaign                             ``label_of``
``folder``     campaign folders and truth on disk                         ``write_campaign``
``campaigns``  campaigns made by worker processes, resuming, sealing      ``make_all``
``units``      the same campaign in other units of mass and length        ``in_other_units``
=============  =========================================================  ===================

It imports numpy and scipy only: nothing of the rotor model, the diagnosis or the FMUs.
"""
