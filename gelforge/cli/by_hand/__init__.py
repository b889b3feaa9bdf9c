"""Commands by hand: press once, fit a material, import logs, verify the solver, judge a recording."""
