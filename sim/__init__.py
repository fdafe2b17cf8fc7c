"""Measurements, virtual and real: one type for both, and the fmpy-driven virtual test rig.

===================  ======================================================  ===========================
module               what it holds                                           start here
===================  ======================================================  ===========================
``campaign``         the types: a run (one stepped sine), a campaign         ``Run``, ``Campaign``
``formats``          campaign CSV, UFF 58, HDF5, MAT                         ``read_run``, ``write_run``
``campaign_folder``  ``campaign.toml`` and its data files                    ``load_campaign``
``archive``          an FMU's file, read within limits                       ``describe``, ``unpack``
``session``          one FMU instance from unzip to free                     ``FmuSession``
``instances``        fmpy's instances, FMI 2.0 and 3.0, by one set of names  ``instance``
``detection``        synchronous detection                                   ``detect``
``sensors``          repeatable sensor noise                                 ``SensorNoise``
``setup``            the rig with its effects, the plan of a sweep           ``Rig``, ``SweepPlan``
``lines``            one line: wait until settled, set the force, read       ``LineReader``
``stepped_sine``     sweeps, refined round each resonance                    ``sweep``
``runs``             several runs, each by an FMU instance of its own        ``sweep_all``
``machine``          a machine that runs: a system of FMUs, by fmpy          ``run_machine``
``signals``          records in SI, and what is clipped                      ``signals_of``
``stepped_records``  lines from records of a settled sine                    ``line_of``
``spectra``          a run from hammer or random records                     ``reduce_spectra``
``oscilloscope``     records of the virtual rig as an oscilloscope's         ``record_lines``
``modal_fit``        modes of a measured frequency response                  ``fit_modes``
``resonances``       poles from the lines beside a peak, on any raster       ``find_resonances``
===================  ======================================================  ===========================

This package uses FMUs through their ``.fmu`` files only.
"""
