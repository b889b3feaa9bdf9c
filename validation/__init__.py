"""Concealed sets: recordings made by FElupe with hidden physics, sealed, judged from outside, then scored and pooled.

Nothing here but the folder `checks` imports the analysis (gelforge.mismatch), and gelforge imports nothing of this; a test
checks both.
"""
