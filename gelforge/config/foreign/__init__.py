"""What other people's files hold: mappings of material tests and of a laboratory's logs.

A study contains none of them: `gelforge.config` imports nothing from here.
"""
