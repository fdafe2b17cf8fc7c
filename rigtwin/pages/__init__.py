"""Self-contained HTML pages and their figures.

=====================  ===========================================  ========================
module                 what it holds                                start here
=====================  ===========================================  ========================
``page``               one page from a template                     ``write_page``
``figures``            plotly figures and the drawing of the rotor  ``frf_figure``
``palette``            the colours of all pages and figures         ``BLUE``
``rotor_figures``      pictures of modes and of the spinning rotor  ``mode_figure``
``diagnosis_page``     the page of a diagnosis                      ``write_diagnosis_page``
``diagnosis_figures``  its figures                                  ``response_figure``
``diagnosis_words``    what a diagnosis says, in words              ``named``
``places``             where it points at the rotor                 ``pointed_at``
``overlay_page``       tables and responses laid over each other    ``write_overlays``
``machine_page``       a machine whose bearing softens              ``write_machine_page``
``provenance``         versions, GUIDs, hashes                      ``provenance``
=====================  ===========================================  ========================
"""
