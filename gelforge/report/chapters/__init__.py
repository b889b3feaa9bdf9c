"""The chapters of a study's report: a function for each, from what its stages left to words, tables and figures.

A chapter that lacks its files says so; `report.page.CHAPTERS` has their order.
"""
