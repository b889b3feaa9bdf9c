"""What the rules of the Snakemake workflow import: forks that solve, patience with Slurm, the time a run still takes.

The rules themselves are in `workflow/` of a checkout and, in a wheel, in this folder (gelforge/shipped.py).
"""
