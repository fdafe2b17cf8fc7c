"""The paper's numbers beside ours: ``python -m benchmarks.reproduction`` writes docs/reproduction.md.

================  ============================================================
module            what it holds
================  ============================================================
``sections``      the list of sections, in the order of the document
``nominal``       the paper's numbers and the paper's rotor
``tables``        Table 1 and the shifts of Table 2
``amplitudes``    the amplitude ratio of Table 2 and what peak picking does to it
``ross``          an independent code on the same rotor
``convergence``   mesh convergence
``damping``       viscous against constant hysteresis damping
``networks``      the paper's neural networks on all splits of its table
``figures``       Fig. 2 and Fig. 3
================  ============================================================

A section is a function without arguments that returns markdown; append it to ``sections.SECTIONS``.
"""
