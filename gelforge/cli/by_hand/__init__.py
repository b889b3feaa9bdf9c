"""Commands that people call on files of their own: press once, fit a material, import logs, verify, judge, calibrate.

`commands` has their arguments.
"""
