"""The diagnosis as a page in the browser, on this machine alone; Dash is the extra ``app``.

============  ==================================================  ==================
module        what it holds                                       start here
============  ==================================================  ==================
``uploads``   files that a browser sends become a campaign        ``unpack``
``worker``    the process that diagnoses, and tells how far       ``main``
``job``       that process as the app sees it                     ``Job``
``view``      the page and what happens on it                     ``make_app``
``server``    who may ask, where it listens, how it ends          ``AppServer``
============  ==================================================  ==================
"""
