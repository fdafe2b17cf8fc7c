"""Structure, condition and effects to the matrices that every solver takes.

================  ==============================================  ================
module            what it holds                                   start here
================  ==============================================  ================
``arrays``        types of arrays, for all rooms
``condition``     how the rotor is held, driven and spun          ``Condition``
``elements``      beam elements from their shape functions        ``timoshenko``
``structure``     free-free matrices and the supports' places     ``Structure``
``design``        the rotor while effects are put into it         ``Design``
``force_laws``    local force laws, each written once             ``ForceLaw``
``printed_laws``  the laws as code, printed by ``build_laws.py``
``local_force``   a law at a joint                                ``LocalForce``
``rotor_model``   structure, condition and effects to matrices    ``build_model``
``speed_tables``  supports that follow the spin speed             ``SpeedTable``
``system``        the linear rotor, its modes and damping         ``LinearSystem``
``html``          tables and drawings for notebooks               ``curves``
``state_space``   the first-order form that all solvers share     ``StateSpace``
================  ==============================================  ================
"""
