"""From a rig file to finite elements.

============  =================================  ============
module        what it holds                      start here
============  =================================  ============
``rig``       the rig TOML and the shipped rigs  ``load_rig``
``assembly``  rig to matrices                    ``assemble``
``drawing``   the rig drawn to scale             ``rig_svg``
============  =================================  ============
"""
