"""Data files of a campaign: CSV, UFF dataset 58, HDF5 and MATLAB, read into the same type of run; and time records.

==================  =======================================================  ===========================
module              what it holds                                            start here
==================  =======================================================  ===========================
``run_file``        one run from a file, one run into a file                 ``read_run``, ``write_run``
``settings``        how a run was measured: keys, checks, defaults           ``RunSettings``
``corrections``     phases, bands, coherence, a controlled response          ``corrected``
``recording``       what a data file holds, before the campaign adds to it   ``Recording``
``csv_header``      the grammar of the CSV's column names                    ``parse_header``
``csv_file``        campaign CSV                                             ``read``, ``write``
``uff``             universal file format, datasets 58, 151 and 164          ``read``, ``write``
``uff_datasets``    its datasets, whatever software wrote them               ``read_datasets``
``units``           units of labels, and their factors to SI                 ``factor_of``
``variables``       named arrays, common to HDF5 and MATLAB                  ``recording_of``
``hdf5``            HDF5                                                     ``read``, ``write``
``matlab``          MATLAB 5 to 7 (read and written) and 7.3 (read)          ``read``, ``write``
``in_child``        HDF5 and MATLAB files decoded in a process of their own  ``decode``
``decoder``         the program of that process                              ``main``
``record``          samples over time, and the checks of all their formats   ``Record``
``record_file``     one record from a file                                   ``read_record``
``record_csv``      records in the text of oscilloscopes and loggers         ``read``
``reduction_plan``  which channel of a record is what, and the method        ``read_plan``
==================  =======================================================  ===========================
"""

from rigtwin.sim.formats.run_file import SUFFIXES, read_run, read_run_and_said, write_run
from rigtwin.sim.formats.settings import RunSettings

__all__ = ["SUFFIXES", "RunSettings", "read_run", "read_run_and_said", "write_run"]
