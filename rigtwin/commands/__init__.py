"""What each command does: parse, call, print; no physics.

===================  ================================================  ================"""
