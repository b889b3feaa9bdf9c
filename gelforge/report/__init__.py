"""What people read: the report of a study, the pages of verdicts and calibrations, and their figures.

Nothing is computed here but means and residuals of what the stages have stored. `page.write_report` and its like are the
entrance; they load matplotlib and are imported where a page is written.
"""
