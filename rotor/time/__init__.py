"""The rotor in the time domain.

=====================  ================================================  ====================
module                 what it holds                                     start here
=====================  ================================================  ====================
``stepper``            exact time stepping of the linear rotor           ``ModalStepper``
``nonlinear_stepper``  time stepping with local force laws               ``NonlinearStepper``
``exciter``            a master's force between its samples              ``Exciter``
``drive``              forces during one step: a signal and pure tones   ``Drive``
``simulator``          the rotor with a clock and a sine generator       ``RotorSimulator``
=====================  ================================================  ====================
"""
