"""The proof on concealed effects: recordings made by FElupe with hidden physics, sealed, judged from outside, then scored.

Nothing here imports the analysis (gelforge.mismatch), and gelforge imports nothing of this; a test checks both.
"""
