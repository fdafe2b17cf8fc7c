"""From measured frequency shifts and amplitude ratio to the bearing stiffness.

======================  =======================================================  =======================
module                  what it holds                                            start here
======================  =======================================================  =======================
``features``            the three numbers a test gives, with their errors        ``features_of_runs``
``prior``               which rigs the network is trained for                    ``PRIOR``
``dataset``             rigs measured through the FMU                            ``measure_rigs``
``network``             the network (torch)                                      ``StiffnessNetwork``
``training``            fit, calibrate, export to ONNX                           ``train``
``intervals``           the width of a 90 % interval                             ``Z90``, ``BETWEEN_CODES``
``onnx_file``           ONNX files in use                                        ``onnx_session``
``runtime``             the ONNX file in use: numpy and onnxruntime only         ``StiffnessEstimator``
``validity``            why an estimate is not valid, in sentences              ``objections``
``root_finding``        the same question answered on the finite-element model   ``StiffnessFinder``
``tracking``            k_b that changes in time, sample by sample               ``StiffnessTracker``
======================  =======================================================  =======================

torch is imported by ``network`` and ``training`` only.
"""
