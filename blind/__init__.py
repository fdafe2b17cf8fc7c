"""The blind benchmark: campaigns with a hidden cause, their sealed labels, and the judge of the answers.

============  =======================================================  ============
room          what it holds                                            start here
============  =======================================================  ============
``generate``  campaigns, by a second implementation of the rotor       ``make_all``
``judge``     answers against labels, and the page of the benchmark    ``page``
============  =======================================================  ============

Nothing here imports the diagnosis, its rotor model or its FMUs. Campaigns that other codes have made are stored in
``benchmarks/stored_campaigns`` of a checkout.
"""

SETS = ("W1", "W2", "W3", "W4", "W5", "W6", "W7", "W8", "W9")
