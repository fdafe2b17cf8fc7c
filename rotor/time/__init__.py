"""The rotor in the time domain.

=====================  ================================================  ====================
module                 what it holds                                     start here
=====================  ================================================  ====================
``stepper``            exact time stepping of the linear rotor           ``ModalStepper``
``nonlinear_stepper``  time stepping with local force laws               ``NonlinearStepper``
``drive``              forces during one step: held ones and pure tones  ``Drive``
``simulator``          the rotor with a clock and a sine generator       ``RotorSimulator``
=====================  ================================================  ====================
"""
